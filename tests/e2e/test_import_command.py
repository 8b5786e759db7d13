"""``oed import``: a proposal that the user corrects, then movements."""

import json

import numpy as np
import pytest
import yaml
from browser import violations_of
from command_line import oed

from robotmodels import iterate_movements

STEP = 0.004
TIME = STEP * np.arange(1500)


@pytest.fixture
def log_file(tmp_path):
    """Six joints in degrees, their speeds and currents, as a controller writes them."""
    phases = np.arange(6)
    angle = 0.3 * np.sin(np.outer(TIME, 2.3 + 0.2 * phases) + phases)
    speed = np.gradient(angle, STEP, axis=0)
    names = [f"{q}_{i}" for q in ("act_pos", "act_vel", "current") for i in range(1, 7)]
    table = np.column_stack([TIME, np.degrees(angle), np.degrees(speed), 2 * np.tanh(9 * speed)])
    path = tmp_path / "log.csv"
    header = ";".join(["time [s]", *names])
    lines = [";".join(f"{x:.9g}".replace(".", ",") for x in row) for row in table]
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


def test_a_proposal_is_written_and_then_taken(log_file, tmp_path):
    code, out, err = oed("import", str(log_file), "--robot", "ur10", "-o", str(log_file.parent))
    assert (code, err) == (0, "")
    assert "nothing was converted" in out
    assert "act_pos_*: motor_angle [deg], joint side" in out
    assert not (tmp_path / "movements.h5").exists()
    mapping = yaml.safe_load((tmp_path / "import.yaml").read_text())
    assert mapping["robot"] == "ur10"
    assert [s["role"] for s in mapping["signals"]] == [
        "motor_angle", "motor_velocity", "motor_current"
    ]  # fmt: skip
    page = tmp_path / "import.html"
    assert "<svg" in page.read_text()
    proposal = page.rename(tmp_path / "proposal.html")
    code, out, _ = oed(
        "import",
        str(log_file),
        "--mapping",
        str(tmp_path / "import.yaml"),
        "--json",
        "-o",
        str(tmp_path),
    )
    assert code == 0
    result = json.loads(out)
    (run,) = result["runs"]
    assert (run["samples"], run["sample_time"]) == (1500, pytest.approx(STEP))
    (movement,) = iterate_movements(tmp_path / "movements.h5")
    assert movement.motor_angle[:, 2] == pytest.approx(0.3 * np.sin(2.7 * TIME + 2), abs=1e-8)
    assert movement.provenance["files"].keys() == {"log.csv"}
    assert violations_of(proposal) == violations_of(page) == []


def test_a_short_mapping_is_completed(log_file, tmp_path):
    mapping = tmp_path / "short.yaml"
    mapping.write_text(
        'schema: import/1\nrobot: ur10\nsignals:\n  - {column: "act_pos_*", role: motor_angle}\n'
    )
    code, out, err = oed(
        "import", str(log_file), "--mapping", str(mapping), "-o", str(log_file.parent)
    )
    assert (code, err) == (0, "")
    assert "act_pos_*: unit deg, side joint" in out


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema: import/1\nsignals: []\n", "signals: at least 1 is needed"),
        ("schema: import/1\nsignal: []\n", "unknown key 'signal' (did you mean 'signals'?)"),
        (
            'schema: import/1\nrobot: ur10\nsignals:\n  - {column: "pos", role: motor_angle}\n',
            "channel 'pos' is missing (did you mean",
        ),
        ("schema: robot/1\nname: a\n", "this is a robot file"),
    ],
)
def test_mistakes_in_a_mapping_are_one_line(log_file, tmp_path, text, message):
    mapping = tmp_path / "wrong.yaml"
    mapping.write_text(text)
    code, _, err = oed(
        "import", str(log_file), "--mapping", str(mapping), "-o", str(log_file.parent)
    )
    assert code == 2
    assert message in err
    assert err.count("\n") == 1


def test_a_periodic_log_becomes_records_for_frfs(tmp_path):
    """Three runs of one joint in a block would be too few; here one motor is excited."""
    rng = np.random.default_rng(1)
    lines = np.arange(3, 40, 2)
    omega = 2 * np.pi * lines / 0.8
    parts = []
    for _ in range(3):
        phase = rng.uniform(0, 2 * np.pi, len(lines))
        wave = np.exp(1j * (np.outer(np.arange(400) * 0.002, omega) + phase))
        part = np.stack([wave.real.sum(axis=1), -(wave / omega**2).real.sum(axis=1) / 2e-3])
        parts.append(np.tile(part, 4) + 1e-9 * rng.standard_normal((2, 1600)))
    torque, angle = np.concatenate(parts, axis=1)
    table = np.column_stack([0.002 * np.arange(len(angle)), angle / 100, torque])
    path = tmp_path / "log.csv"
    np.savetxt(path, table, delimiter=",", header="t,q,tau", comments="", fmt="%.15g")
    mapping = tmp_path / "import.yaml"
    mapping.write_text(
        "schema: import/1\nratios: [100]\nsignals:\n"
        "  - {column: q, role: motor_angle, unit: rad, side: joint}\n"
        "  - {column: tau, role: motor_torque, unit: N*m, side: motor}\n"
    )
    code, out, err = oed("import", str(path), "--mapping", str(mapping), "-o", str(tmp_path))
    assert (code, err) == (0, "")
    assert "period of 400 samples, 0.8 s; 3 runs of 4 to 4 whole periods" in out.replace(
        "\n    ", " "
    )
    code, out, _ = oed("frf", str(tmp_path / "records.h5"), "--no-hold", "--json")
    assert code == 0
    assert json.loads(out)["lines"] == len(lines)
