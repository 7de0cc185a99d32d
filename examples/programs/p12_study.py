"""A study, labelled."""

import zivi


def bounce(e, v):
    return zivi.simulate(zivi.ImpactSystem(-9.81, e=e), (0, 30), (1, v))


study = zivi.sweep(bounce, {"e": [0.3, 0.5, 0.7], "v": [0.0, 2.0]})
print(study.rest_time.sel(v=0.0).values.round(4))
study.to_netcdf("bounces.nc")

# It prints:
# [0.8385 1.3546 2.5586]
