"""What ``oed check`` prints: a robot at a position, in engineering units and aligned columns."""

from collections.abc import Sequence

import numpy as np

from reports import text
from reports.summaries.columns import decimals, hung, number, plural, table, vector, wrapped
from robotmodels.checks.diagnosis import Diagnosis, MotorState, ParameterState, SpringState
from robotmodels.checks.warnings import Suspicion
from robotmodels.common.plain_data import json_data, json_text
from robotmodels.description.friction import equivalent_dampers, friction_sentences
from robotmodels.description.outputs import Output, outputs_of
from robotmodels.description.robot_file import Hardening, RobotFile
from robotmodels.description.unused_elements import UnusedPart

MAIN_SPRINGS = 3  # named per mode, if they hold at least a tenth of its energy
_UNITS = {"acceleration": "rad/s²", "velocity": "rad/s", "position": "rad"}


def robot_summary(
    diagnosis: Diagnosis,
    suspicions: Sequence[Suspicion],
    file: RobotFile,
    unused: Sequence[UnusedPart] = (),
) -> str:
    """Return the whole summary; `file` adds payload, cuts, sensors, `unused` the model file's."""
    d = diagnosis
    sections = [
        _title(d, file),
        _bodies(d, file),
        _motors(d),
        _springs(d, file),
        _others(d),
        _friction(file),
        _outputs(d, file),
        _modes(d),
        _anti_resonances(d),
        _source(d),
        _unused(unused),
        _warnings(suspicions),
    ]
    return "\n\n".join("\n".join(lines) for lines in sections if lines)


def robot_json(
    diagnosis: Diagnosis,
    suspicions: Sequence[Suspicion],
    file: RobotFile,
    unused: Sequence[UnusedPart] = (),
) -> str:
    """Return the same as JSON, in SI units (rad, rad/s, N m) and at full precision."""
    keys = {"gravity", "payload", "counterbalances", "accelerometers", "outputs"}
    settings = file.model_dump(include=keys)
    gains = {motor.name: motor.torque_gain for motor in file.motors}
    lists = {"torque_gains": gains, "warnings": suspicions, "unused": unused}
    lists["friction"] = [json_data(damper) for damper in equivalent_dampers(file)]
    return json_text(json_data(diagnosis) | settings | lists)


def _unused(parts: Sequence[UnusedPart]) -> list[str]:
    """Return what of the model file is not used, in a line each."""
    lines = [line for p in parts for line in wrapped(f"{p.label}: {p.reason}")]
    return ["not used of the model file", *lines] if lines else []


def _title(d: Diagnosis, file: RobotFile) -> list[str]:
    free = sum(p.state == "free" for p in d.parameters)
    lines = [
        f"{d.robot}: {plural(len(d.motors), 'motor')}, {plural(len(d.springs), 'spring')}, "
        f"{free} of {plural(len(d.parameters), 'parameter')} free"
    ]
    behind = ", then the motors behind a spring" if any(m.spring for m in d.motors) else ""
    count = plural(len(d.coordinates), "coordinate")
    lines += wrapped(f"{count}: joints and springs of the bodies, in the order below{behind}")
    position = ", ".join(_angle(m.angle, m.prismatic) for m in d.motors)
    lines += wrapped(f"position: {position}")
    lines += wrapped(f"gravity: ({vector(file.gravity)}) m/s²")
    return lines


def _bodies(d: Diagnosis, file: RobotFile) -> list[str]:
    rows = [
        (
            f"{body.link}, beyond cut" if body.part else body.link,
            ", ".join(body.moved_by),
            number(body.mass, 4),
            vector(body.com, 3),
            number(body.carried, 4),
        )
        for body in d.bodies
    ]
    header = ("bodies", "joints, springs", "mass\nkg", "centre of mass\nm", "carried\nkg")
    lines = table(header, rows, right=(2, 3, 4))
    if (load := file.payload) is not None:
        lines += wrapped(
            f"payload included: {number(load.mass)} kg on {load.link}, "
            f"centre of mass ({vector(load.com, 3)}) m"
        )
    for balance in file.counterbalances:
        lines += wrapped(f"counterbalance {balance.name} on joint {balance.joint}")
    cuts: dict[tuple[str, tuple[float, ...]], list[str]] = {}
    for spring in d.springs:
        if spring.at is not None:
            cuts.setdefault((spring.attached_to, spring.at), []).append(spring.name)
    for (link, at), springs in cuts.items():
        lines += wrapped(f"cut through {link} at ({vector(at, 3)}) m: {', '.join(springs)}")
    return lines


def _motors(d: Diagnosis) -> list[str]:
    rows = [
        (
            m.name,
            m.joint,
            f"{m.gear_ratio:g}",
            number(1e4 * m.inertia),
            number(m.reflected) + (" kg" if m.prismatic else ""),
            number(m.load) + (" kg" if m.prismatic else ""),
            _small(m.torque),
            f"spring {m.spring}" if m.spring else "rigid",
        )
        for m in d.motors
    ]
    header = (
        *("motors", "joint", "ratio", "inertia\nkg cm²", "x ratio²\nkg m²"),
        *("load\nkg m²", "holding\nN m", "drive"),
    )
    return table(header, rows, right=(2, 3, 4, 5, 6))


def _springs(d: Diagnosis, file: RobotFile) -> list[str]:
    """Return springs and dampers with their state, and what gravity does to them."""
    states = {p.name: p for p in d.parameters}
    rows: list[tuple[str, ...]] = []
    for s, spring_entry in zip(d.springs, file.springs, strict=True):
        k = f"{s.name}.stiffness"
        stiffness, damping = states.get(k) or states[f"{k}.low"], states[f"{s.name}.damping"]
        load = (_deflection(s), _small(s.torque) + (" N" if s.linear else ""))
        row = (
            s.name,
            f"{s.attached_to} {s.axis}",
            _kilo(stiffness.value, stiffness.unit),
            _state(stiffness),
        )
        rows.append((*row, _plainly(damping), _state(damping), *load))
        if isinstance(spring_entry.stiffness, Hardening):
            high, reached = states[f"{k}.high"], f"  at {spring_entry.stiffness.torque:g} N m"
            rows.append(("", reached, _kilo(high.value, high.unit), _state(high), *[""] * 4))
            rows.append(("", "  under its load", _kilo(s.stiffness, high.unit), *[""] * 5))
    header = (
        *("springs", "at, about", "stiffness\nkN m/rad", "", "damping\nN m s/rad", ""),
        *("static\ndefl.", "load\nN m"),
    )
    ties = [f"{p.name} to {p.tied_to}" for p in d.parameters if p.tied_to]
    tied = wrapped(f"tied: {', '.join(ties)}") if ties else []
    return table(header, rows, right=(2, 4, 6, 7)) + tied


def _friction(file: RobotFile) -> list[str]:
    """Return what damps behind the gears, and what Coulomb friction counts as."""
    lines = [
        line
        for item in file.friction
        for line in wrapped(
            f"joint {item.joint}, {item.name}: viscous {item.viscous:.4g} N m s/rad"
        )
    ]
    lines += [line for sentence in friction_sentences(file) for line in wrapped(sentence)]
    return ["friction", *lines] if lines else []


def _others(d: Diagnosis) -> list[str]:
    """Return the parameters that are neither stiffness nor damping."""
    springs = tuple(f"{s.name}.{kind}" for s in d.springs for kind in ("stiffness", "damping"))
    rows = [
        (p.name, _value(p.value, p.unit), p.state)
        for p in d.parameters
        if not p.name.startswith(springs)
    ]
    return table(("other parameters", "", ""), rows, right=(1,)) if rows else []


def _outputs(d: Diagnosis, file: RobotFile) -> list[str]:
    lines = []
    if not file.outputs and file.output != "acceleration":
        lines.append(f"  {file.output} of every motor [{_UNITS[file.output]}]")
    listed = [o for o in outputs_of(file) if file.outputs or o.kind != "motor"]
    for output in listed:
        lines += wrapped(_output(output, d.output_units[d.outputs.index(output.label)]))
    if d.delay:
        lines.append(f"  all of them late by {number(1e3 * d.delay)} ms")
    gains = [f"{m.name} {number(m.torque_gain)}" for m in file.motors if m.torque_gain != 1]
    if gains:
        lines += wrapped(f"torque gains other than 1: {', '.join(gains)}")
    return [f"outputs ({len(d.outputs)})", *lines] if lines else []


def _output(output: Output, unit: str) -> str:
    """Return what an output measures, in words."""
    what = f"{output.quantity.replace('_', ' ')} of {output.kind} {output.of}"
    if output.name is not None:
        what = f"{output.who}: {what}"
    if output.kind == "link":
        along = "about" if output.quantity in ("angular_velocity", "torque") else "along"
        what += f" at ({vector(output.point, 3)}) m, {along} ({vector(output.direction or ())})"
    channel = [
        f"gain {number(output.gain)}" if output.gain != 1 else "",
        f"late by {number(1e3 * output.delay)} ms" if output.delay else "",
        f"lag {number(1e3 * output.lag)} ms" if output.lag else "",
    ]
    return ", ".join([f"{what} [{unit.replace('^2', '²')}]", *filter(None, channel)])


def _modes(d: Diagnosis) -> list[str]:
    rows = [
        (
            number(_hertz(mode.frequency)) + " Hz",
            text.fixed(mode.damping_ratio, 3),
            ", ".join(_main_springs(d, mode.energy)),
        )
        for mode in d.modes
    ]
    header = ("resonances", "damping ratio", "energy in springs")
    lines = table(header, rows, right=(0, 1)) if rows else ["resonances"]
    return lines + [line for words in mode_remarks(d) for line in wrapped(words)]


def mode_remarks(d: Diagnosis) -> list[str]:
    """Return in words the modes that are no damped oscillations: overdamped and rigid ones."""
    remarks = []
    if d.modes_failed:
        undamped = ", ".join(number(_hertz(w)) for w in d.resonances)
        remarks.append(f"undamped: {undamped} Hz")
    if d.overdamped:
        remarks.append(
            f"overdamped: {plural(len(d.overdamped), 'real pole')}, "
            f"from {number(_hertz(min(d.overdamped)))} Hz"
        )
    rigid, tip = len(d.rigid_squares), sum(w < -1e-3 for w in d.rigid_squares)
    falls = f"; {tip} unstable under gravity while the motors are free" if tip else ""
    return [*remarks, f"{plural(rigid, 'rigid mode')}, one per motor{falls}"]


def _anti_resonances(d: Diagnosis) -> list[str]:
    high = d.band[1]
    lines = [f"anti-resonances up to {_hertz(high):g} Hz, undamped, and how many lie above"]
    width = max(len(m.name) for m in d.motors)
    for m in d.motors:
        lines += hung(f"  {m.name:<{width}}  ", _zeros(m, high))
    return lines


def _zeros(motor: MotorState, high: float) -> str:
    below = [f"{number(_hertz(w)):>5}" for w in motor.anti_resonances if w <= high]
    above = len(motor.anti_resonances) - len(below)
    more = [f" +{above}"] if above else []
    return "  ".join(below + more)


def _source(d: Diagnosis) -> list[str]:
    return ["source of the numbers", *hung("  ", d.source, indent=2)] if d.source else []


def _warnings(suspicions: Sequence[Suspicion]) -> list[str]:
    lines = [line for s in suspicions for line in hung(f"  {s.rule}: ", s.message)]
    return ["warnings", *lines] if lines else ["no warnings"]


def _main_springs(d: Diagnosis, energy: Sequence[float]) -> list[str]:
    largest = sorted(zip(energy, d.springs, strict=True), key=lambda pair: -pair[0])
    return [
        f"{spring.name} {100 * share:.0f} %"
        for share, spring in largest[:MAIN_SPRINGS]
        if share >= 0.1
    ]


def _state(p: ParameterState) -> str:
    return "" if p.state == "free" else p.state


def _kilo(value: float, unit: str) -> str:
    """Return a stiffness in kN m/rad; with its unit where it is another."""
    return number(value / 1e3) + ("" if unit == "N m/rad" else f" k{unit}")


def _plainly(p: ParameterState) -> str:
    return number(p.value) + ("" if p.unit == "N m s/rad" else f" {p.unit}")


def _value(value: float, unit: str) -> str:
    factor, pretty = text.scaled_unit(value, unit)
    return f"{number(value / factor)} {pretty}"


def _deflection(spring: SpringState) -> str:
    if spring.linear:
        return f"{decimals(1e3 * spring.deflection)} mm"
    return f"{decimals(float(np.degrees(spring.deflection)))}°"


def _angle(value: float, prismatic: bool) -> str:
    return f"{number(_clean(value))} m" if prismatic else f"{_degrees(value):.4g}°"


def _degrees(angle: float) -> float:
    return _clean(float(np.degrees(angle)))


def _hertz(omega: float) -> float:
    return omega / (2 * np.pi)


def _clean(value: float) -> float:
    """Return `value`, or zero if it is rounding only."""
    return 0.0 if abs(value) < 1e-6 else value


def _small(value: float) -> str:
    """Return three digits, none beyond the third decimal."""
    return number(value) if abs(value) >= 1 else decimals(value)
