"""Springs that a robot could have but has not: at joints, in links, foundation and mounting."""

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
from pydantic import ValidationError

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.description.robot_file import Body, RobotFile, Spring
from robotmodels.elastic.arm import AXES, motions
from robotmodels.elastic.robot import ElasticRobot
from robotmodels.elastic.segments import link_inertias

CUTS = (1 / 3, 2 / 3)
"""Where links are cut, as shares of the way from their joint to the next."""

STIFFNESS, DAMPING_TIME = 1e7, 1e-3
"""Of springs whose values are yet unknown [N m/rad, s]: place-holders that no test uses."""

_SHORT = 0.02
"""Length of a link below which its joints are one place [m]."""

_LITTLE = 1e-3
"""Share of a link's mass that is the least a cut takes or leaves."""


def possible_springs(robot: ElasticRobot, cuts: Sequence[float] = CUTS) -> tuple[Spring, ...]:
    """Return the springs that a robot could have but has not.

    Gears of motors that drive rigidly; torsions of driven joints about axes orthogonal to the
    drive; of the foundation, of cuts that the robot has, and of the payload's mounting; and of
    cuts through links between two joints, whose parts are those of a normal distribution of mass
    with the link's inertia. Springs are named after their joint or link; each tells what lies
    beyond its cut.

    Parameters
    ----------
    robot : ElasticRobot
        The robot.
    cuts : sequence of float
        Shares of the way from a link's joint to the next at which links without a cut are cut.

    Raises
    ------
    InvalidInput
        If a share is not between 0 and 1.
    """
    if not all(0 < share < 1 for share in cuts):
        raise InvalidInput(f"cuts: {list(cuts)}; shares between 0 and 1 are needed")
    present = {spring_position(spring) for spring in robot.file.springs}
    absent = [
        spring
        for spring in (*_of_joints(robot), *_of_links(robot, cuts))
        if spring_position(spring) not in present
    ]
    return tuple(_buildable(robot, _renamed(robot, absent)))


def spring_position(spring: Spring) -> tuple[object, str]:
    """Return where a spring is, and about which axis."""
    return spring.joint or (spring.link, spring.at), spring.axis


def with_springs(robot: ElasticRobot, springs: Sequence[Spring], *, free: bool) -> ElasticRobot:
    """Return the robot with further springs, whose stiffness and damping are `free` or fixed.

    Raises
    ------
    InvalidInput
        If one has the name or place of another, or the robot cannot have it.
    """
    file, update = robot.file, dict[str, object]()
    cut = {(s.link, s.at) for s in file.springs}
    added = []
    for spring in springs:
        second = (spring.link, spring.at) in cut  # the first tells what lies beyond a cut
        added.append(spring.model_copy(update={"distal": None}) if second else spring)
        cut.add((spring.link, spring.at))
    if not free:
        names = [f"{s.name}.{entry}" for s in springs for entry in ("stiffness", "damping")]
        fixed = [*file.parameters.fixed, *names]
        update["parameters"] = file.parameters.model_copy(update={"fixed": fixed})
    update["springs"] = [*file.springs, *added]
    content = file.model_copy(update=update).model_dump(by_alias=True, exclude_unset=True)
    try:
        return ElasticRobot(RobotFile.model_validate(content), robot.folder)
    except ValidationError as error:
        reason = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise InvalidInput(f"springs: {reason}") from None


def _renamed(robot: ElasticRobot, springs: Sequence[Spring]) -> list[Spring]:
    """Return springs whose names nothing else of the robot has."""
    file, renamed = robot.file, list[Spring]()
    taken = {*robot.output_names, *robot.rigid.names, *file.lock}
    for part in (file.motors, file.springs, file.counterbalances, file.friction):
        taken.update(item.name for item in part)
    for spring in springs:
        name, number = spring.name, 1
        while name in taken:
            number += 1
            name = f"{spring.name} {number}"
        taken.add(name)
        renamed.append(spring.model_copy(update={"name": name}))
    return renamed


def _buildable(
    robot: ElasticRobot, springs: Sequence[Spring], beside: Sequence[Spring] = ()
) -> list[Spring]:
    """Return the springs that the robot can have together, by bisection: each moves some mass."""
    try:
        with_springs(robot, [*beside, *springs], free=False)
    except InvalidInput:
        if len(springs) == 1:
            return []
        half = len(springs) // 2
        first = _buildable(robot, springs[:half], beside)
        return [*first, *_buildable(robot, springs[half:], [*beside, *first])]
    return list(springs)


def _spring(name: str, axis: str, **where: object) -> Spring:
    # Names of links may have what names of springs may not.
    called = f"{name} {axis}".replace(".", "_").lstrip("=+-@")
    values = {"stiffness": STIFFNESS, "damping": STIFFNESS * DAMPING_TIME}
    return Spring.model_validate({"name": called, "axis": axis, **where, **values})


def _of_joints(robot: ElasticRobot) -> Iterator[Spring]:
    """Yield gears and torsions of driven joints, the robot's own among them."""
    moving = dict(zip(list(robot.rigid.names)[1:], motions(robot.rigid), strict=True))
    for joint in robot.motor_joints:
        yield _spring(joint, "drive", joint=joint)
        drive = moving[joint][:3] + moving[joint][3:]
        for axis, direction in AXES.items():
            if abs(direction @ drive) < 1e-9:
                yield _spring(joint, axis, joint=joint)


def _of_links(robot: ElasticRobot, cuts: Sequence[float]) -> Iterator[Spring]:
    """Yield torsions of cuts: those of the robot, the foundation's, of links, of the mounting."""
    file, rigid = robot.file, robot.rigid
    present = [(str(s.link), (s.link, s.at), None) for s in file.springs if s.link is not None]
    links = {name for name, _, _ in present}
    absent = [cut for cut in _absent_cuts(robot, cuts) if cut[1][0] not in links]
    links |= {str(where[0]) for _, where, _ in absent}
    root = [i for i, f in enumerate(rigid.frames) if f.parentJoint == 0 and f.type == pin.BODY]
    if root and not links & {rigid.frames[i].name for i in root}:
        name = rigid.frames[root[0]].name
        absent.insert(0, (name, (name, (0.0, 0.0, 0.0)), None))
    payload = file.payload
    if payload is not None and payload.mass > 0 and payload.link not in links:
        nothing = Body(mass=0.0, com=(0.0, 0.0, 0.0), inertia=(0.0,) * 6)
        absent.append(("payload mounting", (payload.link, (0.0, 0.0, 0.0)), nothing))
    for name, (link, at), body in dict.fromkeys([*present, *absent]):
        for axis in AXES:
            yield _spring(name, axis, link=link, at=at, distal=body)


_Cut = tuple[str, tuple[str | None, tuple[float, float, float] | None], Body | None]
"""Name, link and point, and what lies beyond."""


def _absent_cuts(robot: ElasticRobot, cuts: Sequence[float]) -> Iterator[_Cut]:
    """Yield cuts through links between two joints."""
    for joint in (robot.rigid.getJointId(name) for name in robot.motor_joints):
        frames = robot.rigid.frames
        link = next(
            (i for i, f in enumerate(frames) if f.parentJoint == joint and f.type == pin.BODY), None
        )
        for share in cuts:
            if link is None:
                continue
            section = _section(robot.rigid, joint, link, share)
            if section is not None:
                name = frames[link].name
                yield f"{name} {100 * share:.0f} %", (name, section[0]), section[1]


def _section(
    rigid: pin.Model, joint: int, link: int, share: float
) -> tuple[tuple[float, float, float], Body] | None:
    """Return where a link is cut, in its frame, and what lies beyond; None of a short link."""
    children = [c for c in range(1, rigid.njoints) if rigid.parents[c] == joint]
    inertia = rigid.frames[link].placement.actInv(
        pin.Inertia.FromDynamicParameters(link_inertias(rigid, joint)[link])
    )
    if len(children) != 1 or inertia.mass <= 0:
        return None
    end = rigid.frames[link].placement.actInv(rigid.jointPlacements[children[0]]).translation
    length = float(np.linalg.norm(end))
    if length < _SHORT:
        return None
    body = body_beyond(inertia, end / length, share * length)
    x, y, z = (float(v) for v in np.round(share * end, 12))
    return None if body is None else ((x, y, z), body)


def body_beyond(inertia: pin.Inertia, direction: Array, distance: float) -> Body | None:
    """Return the part of a body beyond a plane, if its mass is normally distributed.

    Beyond direction . x = distance a normal distribution has, in closed form, the moments of a
    truncated one; so both parts are physically consistent, and together they are the body. None
    where one part has nearly all the mass.

    Parameters
    ----------
    inertia : pin.Inertia
        Of the whole body.
    direction : ndarray, (3,)
        Unit vector.
    distance : float, m
        Of the plane from the origin.
    """
    from scipy.special import ndtr

    identity, com = np.eye(3), np.asarray(inertia.lever)
    spread = (np.trace(inertia.inertia) / 2 * identity - inertia.inertia) / inertia.mass
    along = spread @ direction
    deviation = float(np.sqrt(max(direction @ along, 0.0)))
    if not deviation > 0:
        return None
    a = (distance - float(direction @ com)) / deviation
    share = float(ndtr(-a))
    if not _LITTLE < share < 1 - _LITTLE:
        return None
    hazard = float(np.exp(-(a**2) / 2) / np.sqrt(2 * np.pi) / share)
    spread = spread - np.outer(along, along) / deviation**2 * hazard * (hazard - a)
    mass = share * inertia.mass
    moments = mass * (np.trace(spread) * identity - spread)
    xx, xy, xz, yy, yz, zz = (float(v) for v in moments[np.triu_indices(3)])
    x, y, z = (float(v) for v in com + along / deviation * hazard)
    return Body(mass=mass, com=(x, y, z), inertia=(xx, xy, xz, yy, yz, zz))
