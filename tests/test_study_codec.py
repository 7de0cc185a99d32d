"""Files of the arrays of a study: Zarr writes the same bytes, and reads them."""

import math

import numpy as np
import pytest

from inside import FileCodec, study_head

zarr = pytest.importorskip("zarr", reason="the extra 'study' is not installed")

VALUES = {
    "float64": lambda rng, n: np.where(rng.random(n) < 0.2, np.nan, rng.normal(size=n)),
    "int64": lambda rng, n: rng.integers(-(2**62), 2**62, n),
    "int8": lambda rng, n: rng.integers(0, 3, n).astype(np.int8),
    "bool": lambda rng, n: rng.random(n) < 0.5,
    "string": lambda rng, n: np.array(["", "a", "Zhuravlev–Ivanov"], object)[rng.integers(0, 3, n)],
}


def document(kind, shape, file, part):
    fill = "NaN" if kind == "float64" else study_head.NOTHING[kind]
    dims = tuple("abc")[: len(shape)]
    return study_head._document(kind, study_head.Places(shape, file, part), dims, {}, fill)


def written_by_zarr(array, values, **setting):
    """The files that Zarr makes of the values, by their places."""
    buffer = pytest.importorskip("zarr.core.buffer.cpu").Buffer
    files = {"a/zarr.json": buffer.from_bytes(study_head.json_text(array).encode())}
    store = zarr.storage.MemoryStore(files)
    it = zarr.open_array(store, path="a", mode="r+", zarr_format=3)
    it.with_config(setting)[...] = values
    return {key[4:]: it.to_bytes() for key, it in files.items() if not key.endswith("zarr.json")}


@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.parametrize(
    ("shape", "file", "part"),
    [
        ((1,), (1,), None),
        ((23,), (7,), None),
        ((5, 9), (2, 9), None),
        ((6, 5, 3), (2, 4, 3), None),
        ((100,), (32,), (8,)),
        ((3, 70), (1, 32), (1, 8)),
        ((5, 4, 2), (4, 4, 2), (1, 4, 2)),
        ((6, 2), (8, 2), (1, 2)),
    ],
)
def test_bytes_are_those_of_zarr(kind, shape, file, part):
    values = VALUES[kind](np.random.default_rng(7), math.prod(shape)).reshape(shape)
    array = document(kind, shape, file, part)
    codec, expected = FileCodec(array), written_by_zarr(array, values, write_empty_chunks=True)
    assert len(expected) == math.prod(-(-n // k) for n, k in zip(shape, file, strict=True))
    for key, data in expected.items():
        places = [int(it) * k for it, k in zip(key.split("/"), file, strict=True)]
        own = values[tuple(slice(at, at + k) for at, k in zip(places, file, strict=True))]
        assert codec.encode(own) == data
        found = codec.decode(data)
        assert found.shape == codec.file == file
        np.testing.assert_array_equal(found[tuple(map(slice, own.shape))], own)


@pytest.mark.parametrize("empty", [False, True])
def test_inner_chunks_may_be_in_any_order_or_missing(empty, tmp_path):
    """Zarr orders them along a curve, and may leave out those that hold the fill value alone."""
    values = np.arange(64.0).reshape(8, 8)
    values[:2, 4:] = np.nan
    array = document("float64", (8, 8), (8, 8), (2, 2))
    codec = FileCodec(array)
    there = written_by_zarr(array, values, write_empty_chunks=empty)["0/0"]
    here = codec.encode(values)
    np.testing.assert_array_equal(codec.decode(there), values)
    assert here != there
    study_head.write_json(tmp_path / "zarr.json", array)
    study_head.write_whole(tmp_path / "c" / "0" / "0", here)
    np.testing.assert_array_equal(zarr.open_array(tmp_path, mode="r")[...], values)


@pytest.mark.parametrize("kind", VALUES)
@pytest.mark.parametrize("part", [None, (8,)])
def test_damage_is_an_error(kind, part):
    """Any flipped byte, and any length."""
    codec = FileCodec(document(kind, (32,), (32,), part))
    data = codec.encode(VALUES[kind](np.random.default_rng(7), 32))
    for place in range(len(data)):
        wrong = bytearray(data)
        wrong[place] ^= 0x55
        with pytest.raises((ValueError, RuntimeError)):
            codec.decode(bytes(wrong))
        with pytest.raises((ValueError, RuntimeError)):
            codec.decode(data[:place])
