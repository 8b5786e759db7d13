"""Torques, currents and references in a proposal."""

import numpy as np

from estimators.logs.search import Search
from estimators.logs.torque_sign import torque_sign
from estimators.logs.unit_hypotheses import torque_side
from robotmodels.common.arrays import Array
from robotmodels.logs.units import full_scale_share, stated_unit, unit_factor


def propose_drives(search: Search) -> None:
    """Add torques and currents: units by names, side by size, sign by work."""
    for role, default in (("motor_torque", "N*m"), ("motor_current", "A")):
        if role not in search.members:
            continue
        family = search.members[role]
        _, drive = search.samples(role)
        unit = stated_unit(family.unit, role)
        evidence = "unit by its name" if unit else "unit by its kind alone"
        if full_scale_share(family.unit) is not None:
            unit, evidence = family.unit, "a share by its name: state full_scale, 100 % in SI"
        more: dict[str, object] = {}
        if role == "motor_torque":
            share = full_scale_share(unit) is not None
            size = 1.0 if share else unit_factor(unit or default, role, sliding=True)
            more["side"] = _side(search, size * drive)
            evidence += ", side by its size against the robot's weight"
        stamps, angle = search.samples("motor_angle")
        sign, reason = torque_sign(stamps, angle, drive)
        if sign < 0:
            more["sign"] = -1
        search.add(role, unit or default, f"{evidence}; {reason}", more)


def _side(search: Search, torque: Array) -> str:
    peak = np.nanmax(np.abs(torque), axis=0)
    if search.robot is None or not peak.max() > 0 or len(peak) != len(search.ratios):
        return "joint"
    mass = sum(float(body.mass) for body in search.robot.rigid.inertias)
    return torque_side(peak, search.ratios, mass)


def propose_references(search: Search) -> None:
    """Add references, in the units of what they are references of."""
    for role in ("reference_angle", "reference_velocity"):
        if role in search.members:
            family = search.members[role]
            unit = stated_unit(family.unit, role)
            default = search.angle.unit if role == "reference_angle" else f"{search.angle.unit}/s"
            told = "unit by its name" if unit else "unit as that of the angle"
            search.add(role, unit or default, told, {"side": search.angle.side})
