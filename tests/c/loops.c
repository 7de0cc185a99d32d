/* Closed loops, as they are or (by tools/c/single.sed) with what is computed in single precision. */
#include "plant.h"
#include "zivi.h"

void zivi_track(tracked_loop *it);
void zivi_observe(observed_loop *it);

void zivi_track(tracked_loop *it)
{
    plant mass;
    zivi_tracker tracker;
    zivi_tracker_config config;
    double u = 0.0, before = 0.0;
    long k, n = 0;
    mass.x = it->x, mass.xdot = it->xdot, mass.e = it->e;
    zivi_tracker_defaults(&config);
    config.mu1 = it->mu1, config.mu2 = it->mu2, config.h = it->h, config.e = it->e;
    config.horizon = it->horizon;
    it->code = zivi_tracker_init(&tracker, &config);
    if (it->code == ZIVI_OK)
        it->code = zivi_tracker_reset(&tracker, it->x_ref, it->xdot_ref);
    it->rest = -1.0, it->variation = 0.0, it->error = 0.0;
    for (k = 0; k < it->periods && it->code >= 0; k++) {
        const int rested = mass.x == 0.0 && mass.xdot == 0.0;
        const int still = tracker.x_ref == 0.0 && tracker.xdot_ref == 0.0;
        if (!rested || !still)
            it->rest = -1.0;
        else if (it->rest < 0.0)
            it->rest = k * it->h;
        if (k * it->h >= it->from) {
            n++;
            it->error += (mass.x - tracker.x_ref) * (mass.x - tracker.x_ref);
        }
        it->code = zivi_tracker_step(&tracker, mass.x, mass.xdot, it->force, it->force_ref, &u);
        if (k * it->h > it->from)
            it->variation += fabs(u - before);
        before = u;
        plant_move(&mass, it->force + u, it->h);
    }
    it->u = u;
    it->error = sqrt(it->error / (n > 0 ? n : 1));
    it->variation /= n * it->h;
}

void zivi_observe(observed_loop *it)
{
    plant mass;
    zivi_observer observer;
    zivi_observer_config config;
    unsigned long long seed = 0x853c49e6748fea9bULL;
    long k, n = 0;
    mass.x = it->x, mass.xdot = 0.0, mass.e = it->e;
    zivi_observer_defaults(&config);
    config.h = it->h, config.e = it->e, config.position_only = 1, config.noise_x = it->sigma;
    zivi_observer_init(&observer, &config);
    it->of_xdot = it->of_d = 0.0;
    for (k = 0; k < it->periods; k++) {
        zivi_observer_step(&observer, mass.x + it->sigma * plant_noise(&seed), NAN, it->force, 0.0);
        if (4 * k > it->periods && mass.x > 0.01) {
            n++;
            it->of_xdot += (observer.xdot - mass.xdot) * (observer.xdot - mass.xdot);
            it->of_d += (observer.d - it->unknown) * (observer.d - it->unknown);
        }
        plant_move(&mass, it->force + it->unknown, it->h);
    }
    it->of_xdot = sqrt(it->of_xdot / n), it->of_d = sqrt(it->of_d / n);
    it->refused = observer.refused;
}
