"""The rigid parts of what a joint moves: all of it, or what lies between cuts through links."""

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.description.robot_file import Body, RobotFile, Spring
from robotmodels.description.urdf import check_inertia, check_moments

# How far beyond a uniform box with the link's inertia a cut may lie, in diagonals of the box.
_MARGIN = 0.2


@dataclass(eq=False)
class Segment:
    """A rigid part of what a joint moves.

    Attributes
    ----------
    placement : pin.SE3
        Placement of the cut that starts it, in the frame of the joint.
    links : dict of int to ndarray
        Links whose far ends it has, by their frames in the rigid model: the ten inertial
        parameters, about the joint's frame, of what it has of them (mass [kg], first [kg m] and
        second moments [kg m^2]).
    springs : list of Spring
        Springs of the cut that starts it; none where the joint does.
    parent : Segment or None
        The part before the cut.
    stubs : list of ndarray
        Inertial parameters of what cuts leave it of other links.
    """

    placement: pin.SE3
    links: dict[int, Array]
    springs: list[Spring] = field(default_factory=list)
    parent: "Segment | None" = None
    stubs: list[Array] = field(default_factory=list)

    @property
    def inertia(self) -> pin.Inertia:
        """Inertia in the frame of the joint."""
        return _inertia(self.inertial_parameters)

    @property
    def inertial_parameters(self) -> Array:
        """Mass [kg], first [kg m] and second moments [kg m^2] about the joint's frame, (10,)."""
        return np.asarray(np.sum([np.zeros(10), *self.links.values(), *self.stubs], axis=0))


def segments(file: RobotFile, rigid: pin.Model, joint: int) -> list[Segment]:
    """Return the parts of what rigid joint `joint` moves (0: the ground), parents first.

    Raises
    ------
    InvalidInput
        If a cut cannot be made or leaves a part that no body can be.
    """
    parts = [Segment(pin.SE3.Identity(), link_inertias(rigid, joint))]
    for springs in _cuts(file, rigid, joint):
        parts.append(_cut(rigid, parts, springs, fixed_to_ground=joint == 0))
    payload = file.payload
    if payload is not None:
        frame = link_frame(rigid, payload.link, "payload")
        carrier = next((part for part in parts if frame in part.links), None)
        if carrier is not None:
            if joint == 0 and not carrier.springs:
                raise InvalidInput(f"payload: link {payload.link!r} does not move")
            carrier.links[frame] = carrier.links[frame] + _placed(rigid, frame, payload)
    for part in parts:
        # Neither the ground nor what only carries others needs mass; `check_mass` decides.
        massive = part.inertial_parameters.any() if joint else part.inertia.mass != 0
        if massive and (joint or part.springs):
            check_inertia(part.inertia, _part_name(rigid, joint, parts, part))
    return parts


def link_frame(rigid: pin.Model, name: str, who: str) -> int:
    """Return the frame of link `name`.

    Raises
    ------
    InvalidInput
        If there is no such link; the message starts with `who` asks for it.
    """
    links = [frame.name for frame in rigid.frames if frame.type == pin.BODY]
    check_word(f"{who}:", name, links, "is not a link of the URDF")
    return int(rigid.getFrameId(name, pin.BODY))


def check_bodies(file: RobotFile, rigid: pin.Model) -> None:
    """Refuse a payload or a distal part that no body can be, and a cut outside its link.

    Raises
    ------
    InvalidInput
        Naming the payload or spring.
    """
    if file.payload is not None:
        link_frame(rigid, file.payload.link, "payload")
        _check_body(file.payload, "payload")
    for spring in file.springs:
        if spring.distal is not None:
            _check_body(spring.distal, f"spring {spring.name!r}: 'distal'")
        if spring.link is not None:
            _check_cut_point(rigid, spring)


def _check_body(body: Body, who: str) -> None:
    """Refuse what no body can be; nothing at all is one, at the end of a link or of an arm."""
    if body.mass > 0 or any(body.inertia):
        check_moments(body.mass, body.inertia_matrix, who)


def link_inertias(rigid: pin.Model, joint: int) -> dict[int, Array]:
    """Return the inertial parameters of the links that `joint` moves, each without the others."""
    inertias: dict[int, Array] = {}
    remainder, first = rigid.inertias[joint].toDynamicParameters(), None
    for i, frame in enumerate(rigid.frames):
        if frame.parentJoint != joint or frame.type != pin.BODY:
            continue
        holder = rigid.frames[frame.parentFrame]
        # The root link and the link of the joint itself have no fixed joint that holds them.
        if frame.parentFrame == 0 or holder.type != pin.FIXED_JOINT:
            first = i
            continue
        inertias[i] = holder.placement.act(holder.inertia).toDynamicParameters()
        remainder = remainder - inertias[i]
    return inertias if first is None else {first: remainder} | inertias


def _cuts(file: RobotFile, rigid: pin.Model, joint: int) -> list[list[Spring]]:
    """Return the cuts through links that `joint` moves, outwards."""
    cuts: dict[tuple[str, object], list[Spring]] = {}
    for spring in file.springs:
        if spring.link is None:
            continue
        frame = rigid.frames[link_frame(rigid, spring.link, f"spring {spring.name!r}")]
        if frame.parentJoint == joint:
            cuts.setdefault((spring.link, spring.at), []).append(spring)

    def order(springs: list[Spring]) -> tuple[int, float]:
        beyond = max((s.distal.mass for s in springs if s.distal is not None), default=0.0)
        return _depth(rigid, str(springs[0].link)), -beyond

    return sorted(cuts.values(), key=order)


def _cut(
    rigid: pin.Model, parts: list[Segment], springs: list[Spring], *, fixed_to_ground: bool
) -> Segment:
    """Take what lies beyond a cut off the part that has its link, and return it."""
    who, name = f"spring {springs[0].name!r}", str(springs[0].link)
    link = link_frame(rigid, name, who)
    near = next(part for part in parts if link in part.links)
    distal = [s.distal for s in springs if s.distal is not None]
    if len(distal) > 1:
        raise InvalidInput(f"spring {springs[1].name!r}: 'distal' is given twice for one cut")
    if not distal and not fixed_to_ground:
        raise InvalidInput(
            f"{who}: a cut through link {name!r} needs "
            "'distal', the mass, com and inertia of the part beyond it"
        )
    # Links fixed to the far end of this one lie beyond the cut; without 'distal', an elastic
    # foundation, this one does too.
    far = {i: near.links.pop(i) for i in list(near.links) if _descends(rigid, i, link)}
    if distal:
        part = _placed(rigid, link, distal[0])
        remainder = far[link] - part
        if np.abs(remainder).max() > 1e-12 * np.abs(part).max():
            check_inertia(_inertia(remainder), f"{who}: what its cut leaves of link {name!r}")
            near.stubs.append(remainder)
        far[link] = part
    at = rigid.frames[link].placement * pin.SE3(np.eye(3), np.array(springs[0].at))
    return Segment(at, far, springs, near)


def _descends(rigid: pin.Model, frame: int, ancestor: int) -> bool:
    while frame != ancestor:
        parent = rigid.frames[frame].parentFrame
        if parent == frame:
            return False
        frame = parent
    return True


def _depth(rigid: pin.Model, link: str) -> int:
    """Return how many frames lie between a link and the ground."""
    frame, depth = int(rigid.getFrameId(link, pin.BODY)), 0
    while (parent := rigid.frames[frame].parentFrame) != frame:
        frame, depth = parent, depth + 1
    return depth


def _part_name(rigid: pin.Model, joint: int, parts: list[Segment], part: Segment) -> str:
    body = f"the body moved by joint {rigid.names[joint]!r}" if joint else "the root link"
    beyond = next((p for p in parts if p.parent is part), None)
    if beyond is not None:
        return f"spring {beyond.springs[0].name!r}: what its cut leaves of {body}"
    if part.springs:
        return f"spring {part.springs[0].name!r}: the part of {body} beyond the cut"
    return body


def _check_cut_point(rigid: pin.Model, spring: Spring) -> None:
    """Refuse a cut far outside its link; an elastic foundation may be anywhere."""
    link = link_frame(rigid, str(spring.link), f"spring {spring.name!r}")
    frame = rigid.frames[link]
    if frame.parentJoint == 0:
        return
    low, high = _extent(rigid, link)
    margin = _MARGIN * float(np.linalg.norm(high - low))
    at = np.array(spring.at)
    if np.any(at < low - margin) or np.any(at > high + margin):
        box = " to ".join(str(np.round(corner, 3).tolist()) for corner in (low, high))
        raise InvalidInput(
            f"spring {spring.name!r}: its cut at {list(spring.at or ())} lies outside link "
            f"{spring.link!r}, which reaches from {box} m"
        )


def _extent(rigid: pin.Model, link: int) -> tuple[Array, Array]:
    """Return the box, in its own frame, that holds a link's joints and a body of its inertia.

    A uniform box with the second moments J about the centre of mass is sqrt(3 J / mass) long to
    either side of it.
    """
    frame = rigid.frames[link]
    points = [np.zeros(3)]
    for i, other in enumerate(rigid.frames):
        if i != link and other.type != pin.BODY and other.parentFrame == link:
            if other.type == pin.JOINT:
                placement = rigid.jointPlacements[other.parentJoint]
            else:
                placement = other.placement
            points.append(frame.placement.actInv(placement).translation)
    link_inertia = frame.placement.actInv(_inertia(link_inertias(rigid, frame.parentJoint)[link]))
    if link_inertia.mass > 0:
        second = np.trace(link_inertia.inertia) / 2 - np.diag(link_inertia.inertia)
        half = np.sqrt(3 * np.maximum(second, 0.0) / link_inertia.mass)
        points += [link_inertia.lever - half, link_inertia.lever + half]
    return np.min(points, axis=0), np.max(points, axis=0)


def _placed(rigid: pin.Model, link: int, body: Body) -> Array:
    """Return the inertial parameters of a body on `link` about the frame of the link's joint."""
    com = np.array(body.com)
    about_link = body.inertia_matrix + body.mass * (com @ com * np.eye(3) - np.outer(com, com))
    xx, xy, xz, yy, yz, zz = about_link[np.triu_indices(3)]
    parameters = np.array([body.mass, *(body.mass * com), xx, xy, yy, xz, yz, zz])
    inertia = rigid.frames[link].placement.act(_inertia(parameters))
    return np.asarray(inertia.toDynamicParameters())


def _inertia(parameters: Array) -> pin.Inertia:
    if abs(parameters[0]) < 1e-12:
        return pin.Inertia.Zero()
    return pin.Inertia.FromDynamicParameters(parameters)
