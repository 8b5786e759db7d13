import warnings
from contextlib import contextmanager
from dataclasses import fields, replace

import h5py
import numpy as np
import pytest
import pyuff
from closed_loop import Bench, bench_records
from scipy.io import loadmat, savemat

from estimators import (
    FrfEstimate,
    distortion,
    read_distortion,
    read_frf,
    read_records,
    write_distortion,
    write_frf,
    write_records,
)
from robotmodels import InvalidInput, RelativeNoise
from robotmodels.records.records import Records

ALL = (".h5", ".hdf5", ".mat", ".csv")


def frf(q=2, f=3, m=2, n=3, full=True, seed=0):
    rng = np.random.default_rng(seed)
    mn = m * n
    a = rng.standard_normal((q, f, mn, mn)) + 1j * rng.standard_normal((q, f, mn, mn))
    covariance = a @ np.conj(np.swapaxes(a, -1, -2)) + np.eye(mn)
    covariance = (covariance + np.conj(np.swapaxes(covariance, -1, -2))) / 2
    return FrfEstimate(
        positions=rng.standard_normal((q, n)),
        omega=np.cumsum(rng.random(f)) * np.pi,
        response=rng.standard_normal((q, f, m, n)) + 1j * rng.standard_normal((q, f, m, n)),
        covariance=covariance if full else rng.random((q, f, m, n)),
        repetitions=np.arange(1, q + 1),
    )


def records(**setup):
    found = bench_records(Bench(**({"blocks": 2, "periods": 2, "noise": 1e-5} | setup)))
    part = slice(0, 170)  # a hundred-odd samples are enough for a file
    return replace(
        found,
        reference=found.reference[..., part, :],
        torque=found.torque[..., part, :],
        angle=found.angle[..., part, :],
    )


def same(a, b):
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        assert np.shape(x) == np.shape(y), field.name
        assert np.array_equal(x, y, equal_nan=np.asarray(x).dtype.kind == "f"), field.name


# FRFs -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ALL)
@pytest.mark.parametrize("shape", [(2, 3, 2, 3), (1, 1, 1, 1), (1, 2, 3, 1), (3, 1, 1, 2)])
@pytest.mark.parametrize("full", [True, False])
def test_frfs_keep_every_bit(tmp_path, suffix, shape, full):
    estimate = frf(*shape, full=full and shape[2:] != (1, 1))
    write_frf(tmp_path / f"frf{suffix}", estimate)
    same(estimate, read_frf(tmp_path / f"frf{suffix}"))
    assert [p.name for p in tmp_path.iterdir()] == [f"frf{suffix}"]


@pytest.mark.parametrize("suffix", [".uff", ".unv"])
@pytest.mark.parametrize("shape", [(2, 3, 2, 3), (1, 2, 1, 1)])
def test_universal_files_keep_variances_and_the_last_but_one_bit_of_frequencies(
    tmp_path, suffix, shape
):
    estimate = frf(*shape, full=shape[2:] != (1, 1))
    write_frf(tmp_path / f"frf{suffix}", estimate)
    found = read_frf(tmp_path / f"frf{suffix}")
    assert [p.name for p in tmp_path.iterdir()] == [f"frf{suffix}"]
    assert (np.abs(found.omega - estimate.omega) <= 2 * np.spacing(estimate.omega)).all()
    for name in ("positions", "response", "variance", "repetitions"):
        assert (getattr(found, name) == getattr(estimate, name)).all(), name


def test_universal_files_are_what_the_format_says(tmp_path):
    path, estimate = tmp_path / "frf.uff", frf()
    write_frf(path, estimate)
    with ignore_unclosed_files():
        sets = pyuff.UFF(str(path)).read_sets()
    one = next(s for s in sets if s["func_type"] == 4 and s["rsp_node"] == 2 and s["ref_node"] == 3)
    assert (one["rsp_dir"], one["ref_dir"], one["ver_num"]) == (4, 4, 1)
    assert (one["ordinate_spec_data_type"], one["orddenom_spec_data_type"]) == (12, 13)
    assert one["abscissa_spec_data_type"] == 18
    assert np.allclose(one["x"], estimate.omega / (2 * np.pi))
    assert (one["data"] == estimate.response[0, :, 1, 2]).all()
    # The header's count of bytes is what follows it: abscissa, real and imaginary part.
    assert one["n_bytes"] == 8 * 3 * len(estimate.omega)


def foreign(path, change=lambda sets: sets):
    """A file of another program: functions only, nodes 10 and 20, no variances."""
    x = np.array([1.0, 2.0, 4.0])
    sets = [
        {
            "type": 58,
            "binary": 0,
            "id1": "some program",
            "id2": f"FRF {i} {j}",
            "func_type": 4,
            "rsp_node": i,
            "rsp_dir": 1,
            "ref_node": j,
            "ref_dir": 1,
            "abscissa_spacing": 0,
            "abscissa_spec_data_type": 18,
            "ordinate_spec_data_type": 12,
            "orddenom_spec_data_type": 13,
            "data": (i + 1j * j) * x,
            "x": x,
        }
        for i in (10, 20)
        for j in (10, 20)
    ]
    with ignore_unclosed_files():
        for one in change(sets):
            pyuff.UFF(str(path)).write_sets(one, mode="add")


@contextmanager
def ignore_unclosed_files():
    """pyuff does not close its files; they close when it is done with them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        yield


def test_universal_files_of_other_programs(tmp_path):
    path = tmp_path / "other.uff"
    foreign(path)
    with pytest.raises(InvalidInput, match="no variances; give the law of the errors as noise="):
        read_frf(path)
    noise = RelativeNoise(0.1, 0.01)
    with pytest.raises(InvalidInput, match=r"other.uff: no positions; give them as positions="):
        read_frf(path, noise=noise)
    found = read_frf(path, positions=np.zeros((1, 2)), noise=noise)
    expected = np.array([[10 + 10j, 10 + 20j], [20 + 10j, 20 + 20j]])
    assert np.allclose(found.response[0, 1], 2 * expected)
    assert (found.variance == noise.variance(found.response)).all()


def _without_one(sets):
    return sets[:-1]


def _twice(sets):
    return [*sets, sets[0]]


def _displacement(sets):
    return [sets[0] | {"ordinate_spec_data_type": 8}, *sets[1:]]


def _other_lines(sets):
    return [*sets[:-1], sets[-1] | {"x": np.array([1.0, 2.0, 5.0])}]


def _each(**entries):
    return lambda sets: [s | entries for s in sets]


@pytest.mark.parametrize(
    ("change", "factor", "hertz"),
    [
        (_each(ordinate_axis_units_lab="deg/s^2"), np.pi / 180, 1.0),
        (_each(ordinate_axis_units_lab="rad/s**2"), 1.0, 1.0),
        (_each(orddenom_axis_units_lab="N cm"), 100.0, 1.0),
        (_each(abscissa_axis_units_lab="rad/s"), 1.0, 1 / (2 * np.pi)),
        (_each(abscissa_axis_units_lab="RPM"), 1.0, 1 / 60),
        (_each(rsp_dir=-4), -1.0, 1.0),
        (_each(rsp_dir=-4, ref_dir=-1), 1.0, 1.0),
    ],
)
def test_units_and_directions_of_universal_files_are_obeyed(tmp_path, change, factor, hertz):
    path, noise, positions = tmp_path / "other.uff", RelativeNoise(), np.zeros((1, 2))
    foreign(path)
    plain = read_frf(path, positions=positions, noise=noise)
    path.unlink()
    foreign(path, change)
    estimate = read_frf(path, positions=positions, noise=noise)
    assert np.allclose(estimate.response, factor * plain.response, rtol=1e-12)
    assert np.allclose(estimate.omega, hertz * plain.omega, rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_each(ordinate_axis_units_lab="V"), "nodes 10 and 10: ordinate in 'V'; possible are rad"),
        (_each(orddenom_axis_units_lab="A"), "denominator in 'A'; possible are nm"),
        (_each(orddenom_axis_units_lab="MNm"), "denominator in 'MNm'"),
        (_each(abscissa_axis_units_lab="s"), "abscissa in 's'; possible are hz"),
        (_each(orddenom_spec_data_type=12), "denominator of type 12; torques"),
        (_each(ref_dir=7), "ref_dir 7; -6 to 6 are needed"),
        (_each(x=np.array([1.0, 4.0, 2.0])), "frequency 2 .* does not lie above frequency 1"),
        (
            lambda sets: [
                {"type": 164, "units_code": 5, "length": 1e3, "force": 1e3}
                | {"temp": 1.0, "temp_offset": 0.0},
                *sets,
            ],
            r"units \(dataset 164\): code 5, .* length 1000 and force 1000; export in SI",
        ),
        (_without_one, "no function for position 0, response node 20, reference node 20"),
        (_twice, "nodes 10 and 10: given twice"),
        (_displacement, r"ordinate of type 8; accelerations \(12\) are needed"),
        (_other_lines, "nodes 20 and 20: its frequencies differ"),
        (lambda sets: [s | {"func_type": 1} for s in sets], "no frequency response function"),
    ],
)
def test_faulty_universal_files_are_named(tmp_path, change, message):
    path = tmp_path / "other.uff"
    foreign(path, change)
    with pytest.raises(InvalidInput, match=message):
        read_frf(path, positions=np.zeros((1, 2)), noise=RelativeNoise())


def test_what_universal_files_cannot_hold(tmp_path):
    with pytest.raises(InvalidInput, match="one frequency; UFF 58 is written from two on"):
        write_frf(tmp_path / "frf.uff", frf(f=1))
    assert not list(tmp_path.iterdir())
    (tmp_path / "text.uff").write_text("    -1\n    58\n    -1\n")
    with pytest.raises(InvalidInput, match="not a universal file that pyuff can read"):
        read_frf(tmp_path / "text.uff")


# Records ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ALL)
def test_records_keep_every_bit(tmp_path, suffix):
    one = records()
    torque, angle = np.array(one.torque), np.array(one.angle)
    torque[0, 1, 0], angle[0, 1, 0] = np.nan, np.nan  # a missing run
    saturated = np.array(one.saturated)
    saturated[0, 0, 1, 1, 0] = True
    one = replace(one, torque=torque, angle=angle, saturated=saturated)
    both = Records.join([one, records(seed=3)])
    write_records(tmp_path / f"records{suffix}", both)
    same(both, read_records(tmp_path / f"records{suffix}"))
    assert [p.name for p in tmp_path.iterdir()] == [f"records{suffix}"]


def test_a_table_of_records_may_call_its_runs_experiments(tmp_path):
    path, one = tmp_path / "records.csv", records()
    write_records(path, one)
    written = path.read_text()
    path.write_text(written.replace("block,run,", "block,experiment,"))
    with pytest.warns(DeprecationWarning, match="records.csv: 'experiment' is now 'run'.*0.3"):
        same(one, read_records(path))
    path.write_text(written.replace("block,run,period,", "experiment,run,period,"))
    with pytest.raises(InvalidInput, match="'block' is missing"):
        read_records(path)


@pytest.mark.parametrize("suffix", ALL)
def test_one_motor_one_of_everything(tmp_path, suffix):
    one = records(blocks=1, periods=1, experiments=1)
    single = {k: getattr(one, k)[..., :1] for k in ("positions", "reference", "torque", "angle")}
    small = replace(
        one, **single, saturated=one.saturated[..., :1], detection=np.array([], dtype=int)
    )
    write_records(tmp_path / f"one{suffix}", small)
    same(small, read_records(tmp_path / f"one{suffix}"))


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
def test_distortions_keep_every_bit(tmp_path, suffix):
    found = distortion(bench_records(Bench(blocks=1, periods=2, noise=1e-5)))
    write_distortion(tmp_path / f"d{suffix}", found)
    same(found, read_distortion(tmp_path / f"d{suffix}"))


# Mistakes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("action", [write_frf, write_records, write_distortion])
def test_unknown_endings_are_refused_before_anything_is_written(tmp_path, action):
    with pytest.raises(
        InvalidInput, match=r"x.txt: ending '.txt' is unknown .*; there are .h5, .mat"
    ):
        action(tmp_path / "x.txt", frf())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".h5", ".mat", ".csv"])
@pytest.mark.parametrize("read", [read_frf, read_records])
def test_wrong_files_are_named(tmp_path, suffix, read):
    path = tmp_path / f"a{suffix}"
    with pytest.raises(InvalidInput, match=rf"a{suffix}: no such file"):
        read(path)
    path.write_text("nothing like it\n")
    with pytest.raises(InvalidInput, match=rf"a{suffix}: "):
        read(path)
    path.unlink()
    # FRFs where records are needed, and the other way round.
    if read is read_frf:
        write_records(path, records())
    else:
        write_frf(path, frf())
    with pytest.raises(InvalidInput, match=r"'?schema'? is .*/1' is needed"):
        read(path)


def test_missing_fields_are_named(tmp_path):
    write_frf(tmp_path / "a.h5", frf())
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        del file["omega"]
    with pytest.raises(InvalidInput, match=r"a.h5: 'omega' is missing \(found: .*response"):
        read_frf(tmp_path / "a.h5")
    write_frf(tmp_path / "a.mat", frf())
    content = loadmat(tmp_path / "a.mat")
    kept = {k: v for k, v in content.items() if k[0] != "_" and k != "response"}
    savemat(tmp_path / "a.mat", kept)
    with pytest.raises(InvalidInput, match=r"a.mat: 'response' is missing"):
        read_frf(tmp_path / "a.mat")
    savemat(tmp_path / "a.mat", {k: v for k, v in kept.items() if k not in ("schema", "omega")})
    with pytest.raises(InvalidInput, match=r"'schema', 'omega', 'response' are missing"):
        read_frf(tmp_path / "a.mat")


def test_faults_inside_name_the_file(tmp_path):
    write_frf(tmp_path / "a.h5", frf())
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["omega"][0] = -1.0
    with pytest.raises(InvalidInput, match=r"a.h5: omega: frequency 0 is -1"):
        read_frf(tmp_path / "a.h5")


def version_7_3(path, contents):
    """Write what MATLAB's ``save -v7.3`` does: a header, then HDF5 with axes in reverse."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in contents.items():
            kind = {"U": "char", "b": "logical"}.get(np.asarray(value).dtype.kind, "double")
            array = np.atleast_2d([ord(c) for c in value] if kind == "char" else value)
            if np.iscomplexobj(array):
                pairs = np.empty(array.shape, [("real", "<f8"), ("imag", "<f8")])
                pairs["real"], pairs["imag"] = array.real, array.imag
                array = pairs
            while array.ndim > 2 and array.shape[-1] == 1:
                array = array[..., 0]
            empty = not array.size
            stored = {"char": "<u2", "logical": "u1"}.get(kind, array.dtype)
            file[name] = np.array(array.shape, "<u8") if empty else array.T.astype(stored)
            file[name].attrs["MATLAB_class"] = np.bytes_(kind)
            if empty:
                file[name].attrs["MATLAB_empty"] = np.uint8(1)
        file.create_group("#refs#")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize("full", [True, False])
def test_mat_files_of_version_7_3_are_read(tmp_path, full):
    path, estimate = tmp_path / "a.mat", frf(2, 3, 2, 1, full=full)
    version_7_3(
        path,
        {f.name: getattr(estimate, f.name) for f in fields(estimate) if f.name != "deviations"}
        | {"schema": "frf/1"},
    )
    same(estimate, read_frf(path))
    one = replace(records(), detection=[])
    arrays = {f.name: getattr(one, f.name) for f in fields(one) if f.name != "command"}
    version_7_3(path, arrays | {"schema": "records/1"})
    same(one, read_records(path))


@pytest.mark.parametrize("suffix", [".h5", ".mat", ".csv", ".uff"])
def test_degrees_of_freedom_travel_with_the_covariance(tmp_path, suffix):
    """Without them four blocks would count as known noise: intervals 1.7 times too narrow."""
    estimate, path = frf(), tmp_path / f"a{suffix}"
    write_frf(path, replace(estimate, degrees_of_freedom=[3.0, np.inf], line_correlation=[0.5]))
    found = read_frf(path)
    assert found.degrees_of_freedom.tolist() == [3.0, np.inf]
    assert found.has_degrees_of_freedom
    if suffix != ".uff":
        assert found.line_correlation.tolist() == [0.5]


@pytest.mark.parametrize("suffix", [".h5", ".mat"])
def test_draws_of_the_errors_are_kept(tmp_path, suffix):
    rng, plain = np.random.default_rng(3), frf(full=False)
    shape = (2, 4, *plain.response.shape[1:])
    draws = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
    variance = (np.abs(draws) ** 2).sum(axis=1)
    estimate = replace(plain, covariance=variance, deviations=draws, degrees_of_freedom=4.0)
    write_frf(tmp_path / f"a{suffix}", estimate)
    same(estimate, read_frf(tmp_path / f"a{suffix}"))


def test_files_from_before_leave_degrees_of_freedom_unknown(tmp_path):
    path = tmp_path / "a.h5"
    write_frf(path, frf())
    with h5py.File(path, "a") as file:
        del file["degrees_of_freedom"]
    found = read_frf(path)
    assert np.isnan(found.degrees_of_freedom).all()
    assert not found.has_degrees_of_freedom


def _edit(path, change):
    path.write_text("".join(change(path.read_text().splitlines(keepends=True))))


def _swap(lines):
    return [*lines[:-2], lines[-1], lines[-2]]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: lines[:-1], r"a.csv: 1359 rows; 1 x 2 x 2 x 2 x 170 = 1360 are needed"),
        (_swap, r"row 1358 of the table .* a row is missing or out of order"),
        (lambda lines: [x.replace("torque_", "moment_") for x in lines], "column 'torque_0' is"),
        (lambda lines: [x.replace(",block", ",blok") for x in lines], "column 'block' is missing"),
        (lambda lines: [x for x in lines if "sample_time" not in x], "'sample_time' is missing"),
        (lambda lines: [*lines[:-1], "one,two\n"], "no table of numbers|not a table of numbers"),
        (lambda lines: lines[:6], "no table|not a table|rows"),
        (lambda lines: [x.replace("angle_1,", "") for x in lines], "12 names for 13 columns"),
    ],
)
def test_faulty_tables_are_named(tmp_path, change, message):
    path = tmp_path / "a.csv"
    write_records(path, records())
    _edit(path, change)
    with pytest.raises(InvalidInput, match=message):
        read_records(path)


def test_frf_tables_with_gaps_are_named(tmp_path):
    path = tmp_path / "a.csv"
    write_frf(path, frf(full=False))
    _edit(path, lambda lines: lines[:-1])
    with pytest.raises(InvalidInput, match=r"35 rows; .* = 24 are needed"):
        read_frf(path)
    write_frf(path, frf())
    _edit(path, lambda lines: [x.rsplit(",", 2)[0] + "\n" if x[0] != "#" else x for x in lines])
    with pytest.raises(InvalidInput, match="column 'covariance_re_5' is missing"):
        read_frf(path)
