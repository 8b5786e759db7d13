"""MJCF files as URDF: bodies, joints and drives of MuJoCo's compiled model, number by number.

MuJoCo moves a body by its joints in order, each about its own point: here each is a joint with a
massless link of its own. Angles and distances are MuJoCo's, `ref` included.
"""

import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput
from robotmodels.common.printing import printable
from robotmodels.description.mjcf_shapes import add_shapes
from robotmodels.description.urdf_elements import number_text
from robotmodels.description.xml_reader import read_xml

_SLIDE = 10.0
"""Ends of the range of a sliding joint that has none [m]."""


def urdf_of_mjcf(path: Path) -> str:
    """Return the URDF that an MJCF file amounts to.

    Besides what a URDF has, its root has a ``gravity`` and ``<dynamics>`` an ``armature``. Bodies
    with a free joint have a floating one. Sites are links without mass.

    Raises
    ------
    InvalidInput
        If MuJoCo refuses the file, a joint is a ball joint, or bodies are coupled by more than a
        linear relation of two joints.
    """
    return ET.tostring(_Converter(_compiled(path)[0], path).robot(), encoding="unicode")


def resolved_mjcf(path: Path) -> str:
    """Return an MJCF file as MuJoCo writes it again: includes and frames resolved.

    Raises
    ------
    InvalidInput
        In MuJoCo's words, if it refuses the file.
    """
    return str(_compiled(path)[1])


def files_of_mjcf(path: Path) -> Iterator[Path]:
    """Yield an MJCF file and those that it names: included ones, meshes, height fields."""
    yield from _named_files(path, path.parent, ())


def _named_files(path: Path, folder: Path, above: Sequence[Path]) -> Iterator[Path]:
    yield path
    root = read_xml(path)
    keys = ("meshdir", "assetdir", "texturedir")
    stated = [c.get(key) for c in root.iter("compiler") for key in keys]
    folders = (*above, folder, *(folder / name for name in stated if name))
    for element in root.iter():
        name = element.get("file")
        file = next((f for at in folders if name and (f := at / name).is_file()), None)
        if file and element.tag == "include":
            yield from _named_files(file, folder, folders)
        elif file:
            yield file


def _compiled(path: Path) -> tuple[Any, str]:
    """Return MuJoCo's model of a file, and the file as it writes it.

    Raises
    ------
    InvalidInput
        In MuJoCo's words, if it refuses the file.
    """
    import mujoco

    handler = mujoco.get_mju_user_warning()
    try:
        with warnings.catch_warnings():  # of what MuJoCo will not read some day
            warnings.simplefilter("ignore")
            # MuJoCo's own handler writes MUJOCO_LOG.TXT into the folder one happens to be in.
            mujoco.set_mju_user_warning(lambda *_: None)
            spec = mujoco.MjSpec.from_file(str(path))
            return spec.compile(), spec.to_xml()
    except (ValueError, OSError) as error:
        cause = printable(" ".join(str(error).split()))
        raise InvalidInput(f"{path}: MuJoCo refuses it: {cause}") from None
    finally:
        mujoco.set_mju_user_warning(handler)


class _Converter:
    def __init__(self, model: Any, path: Path) -> None:
        import mujoco

        self.mj, self.model, self.path = mujoco, model, path
        self.bodies = self._names(model.nbody, mujoco.mjtObj.mjOBJ_BODY, "body")
        self.joints = self._names(model.njnt, mujoco.mjtObj.mjOBJ_JOINT, "joint")
        self.links = set(self.bodies)
        # Fixed joints, which nobody names, must differ from those that move.
        self.taken = set(self.joints)

    def robot(self) -> ET.Element:
        model = self.model
        name = model.names[: model.names.index(b"\0")].decode() or "robot"
        root = ET.Element("robot", name=name, gravity=number_text(model.opt.gravity))
        followers = self._couplings()
        for i, body in enumerate(self.bodies):
            link = ET.SubElement(root, "link", name=body)
            self._add_inertial(link, i)
            add_shapes(link, model, i, self.path)
            if i:
                self._add_joints(root, i, followers)
        for i in range(model.nsite):
            if site := model.site(i).name:
                mark = self._new_link(root, site, "site")
                body = self.bodies[model.site_bodyid[i]]
                at = pin.SE3(_matrix(model.site_quat[i]), model.site_pos[i])
                self._add_fixed(root, (body, mark), at)
        self._add_transmissions(root)
        return root

    def _names(self, count: int, kind: Any, word: str) -> list[str]:
        """Return the names of all objects of a kind, new ones where there is none."""
        stated = [self.mj.mj_id2name(self.model, kind, i) for i in range(count)]
        taken = {name for name in stated if name}
        names = []
        for i, name in enumerate(stated):
            names.append(name or _new_name(f"{word}{i}", taken))
        return names

    def _new_link(self, root: ET.Element, name: str, word: str) -> str:
        link = name if name not in self.links else _new_name(f"{name} {word}", self.links)
        self.links.add(link)
        ET.SubElement(root, "link", name=link)
        return link

    def _add_inertial(self, link: ET.Element, i: int) -> None:
        model = self.model
        if model.body_mass[i] == 0 or i == 0:
            return
        turn = _matrix(model.body_iquat[i])
        moments = turn @ np.diag(model.body_inertia[i]) @ turn.T
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=number_text(model.body_ipos[i]), rpy="0 0 0")
        ET.SubElement(inertial, "mass", value=repr(float(model.body_mass[i])))
        entries = zip(
            ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), moments[np.triu_indices(3)], strict=True
        )
        ET.SubElement(inertial, "inertia", {key: repr(float(value)) for key, value in entries})

    def _add_joints(self, root: ET.Element, i: int, followers: dict[int, dict[str, str]]) -> None:
        """Add the joints of a body, each with a link; the last is the body, if at its origin."""
        model, body = self.model, self.bodies[i]
        first, count = int(model.body_jntadr[i]), int(model.body_jntnum[i])
        here = self.bodies[model.body_parentid[i]]
        start = pin.SE3(_matrix(model.body_quat[i]), model.body_pos[i])
        point = np.zeros(3)  # where the last joint is, in the frame of the body
        for j in range(first, first + count):
            kind = self._kind(j)
            if kind == "free":
                self._add_free(root, j, (here, body), start)
                return
            new = model.jnt_pos[j] if kind == "hinge" else point
            at_end = j == first + count - 1 and not new.any()
            link = body if at_end else self._new_link(root, body, self.joints[j])
            joint = self._add_moving(root, j, kind, (here, link))
            if j in followers:
                ET.SubElement(joint, "mimic", followers[j])
            _add_origin(joint, start * pin.SE3(np.eye(3), new - point) * self._undone(j, kind))
            here, point, start = link, new, pin.SE3.Identity()
        if here != body:
            self._add_fixed(root, (here, body), start * pin.SE3(np.eye(3), -point))

    def _add_free(self, root: ET.Element, j: int, links: tuple[str, str], at: pin.SE3) -> None:
        joint = ET.SubElement(root, "joint", name=self.joints[j], type="floating")
        _add_origin(joint, at)
        for end, link in zip(("parent", "child"), links, strict=True):
            ET.SubElement(joint, end, link=link)

    def _undone(self, j: int, kind: str) -> pin.SE3:
        """Return the motion by which `ref`, the angle where a joint has not moved, is undone."""
        twist = -self.model.qpos0[self.model.jnt_qposadr[j]] * self.model.jnt_axis[j]
        if kind == "slide":
            return pin.SE3(np.eye(3), twist)
        return pin.SE3(pin.exp3(twist), np.zeros(3))

    def _kind(self, j: int) -> str:
        kind = self.mj.mjtJoint(self.model.jnt_type[j]).name.removeprefix("mjJNT_").lower()
        if kind == "ball":
            raise InvalidInput(
                f"{self.path}: joint {self.joints[j]!r} is a ball joint; three hinges are needed"
            )
        return str(kind)

    def _add_moving(
        self, root: ET.Element, j: int, kind: str, links: tuple[str, str]
    ) -> ET.Element:
        model, limited = self.model, bool(self.model.jnt_limited[j])
        word = "prismatic" if kind == "slide" else "revolute" if limited else "continuous"
        joint = ET.SubElement(root, "joint", name=self.joints[j], type=word)
        ET.SubElement(joint, "parent", link=links[0])
        ET.SubElement(joint, "child", link=links[1])
        ET.SubElement(joint, "axis", xyz=number_text(model.jnt_axis[j]))
        low, high = model.jnt_range[j] if limited else (-_SLIDE, _SLIDE)
        limit = {"lower": repr(float(low)), "upper": repr(float(high))}
        limit |= {} if limited or kind != "slide" else {"assumed": "true"}
        ET.SubElement(joint, "limit", limit | {"effort": repr(self._effort(j)), "velocity": "0"})
        dof = model.jnt_dofadr[j]
        numbers = {
            "damping": model.dof_damping[dof],
            "friction": model.dof_frictionloss[dof],
            "armature": model.dof_armature[dof],
        }
        dynamics = {key: repr(float(value)) for key, value in numbers.items()}
        ET.SubElement(joint, "dynamics", dynamics)
        return joint

    def _effort(self, j: int) -> float:
        """Return the largest effort of a joint; 0 where nothing limits it."""
        model = self.model
        if model.jnt_actfrclimited[j]:
            return float(np.abs(model.jnt_actfrcrange[j]).max())
        efforts = [0.0]
        for a in self._actuators(j):
            gear = abs(float(model.actuator_gear[a, 0]))
            if model.actuator_forcelimited[a]:
                efforts.append(gear * float(np.abs(model.actuator_forcerange[a]).max()))
            elif model.actuator_ctrllimited[a] and not model.actuator_biasprm[a].any():
                control = float(np.abs(model.actuator_ctrlrange[a]).max())
                efforts.append(gear * control * abs(float(model.actuator_gainprm[a, 0])))
        return max(efforts)

    def _actuators(self, j: int) -> list[int]:
        kind, ids = self.model.actuator_trntype, self.model.actuator_trnid[:, 0]
        return [int(a) for a in np.flatnonzero((kind == self.mj.mjtTrn.mjTRN_JOINT) & (ids == j))]

    def _add_transmissions(self, root: ET.Element) -> None:
        for j, name in enumerate(self.joints):
            gears = {float(self.model.actuator_gear[a, 0]) for a in self._actuators(j)} - {0.0}
            if len(gears) == 1:
                transmission = ET.SubElement(root, "transmission", name=name)
                ET.SubElement(transmission, "joint", name=name)
                actuator = ET.SubElement(transmission, "actuator", name=name)
                ET.SubElement(actuator, "mechanicalReduction").text = repr(*gears)

    def _couplings(self) -> dict[int, dict[str, str]]:
        """Return what each joint follows, by the equality constraints.

        q1 - ref1 = c0 + c1 (q2 - ref2) is q1 = c1 q2 + (ref1 + c0 - c1 ref2).
        """
        model, followers = self.model, {}
        for e in np.flatnonzero(model.eq_active0):
            kind = self.mj.mjtEq(model.eq_type[e]).name.removeprefix("mjEQ_").lower()
            who = f"{self.path}: equality {model.equality(e).name or int(e)!r} ({kind})"
            if kind != "joint":
                what = "is not supported" if kind == "tendon" else "closes a loop of bodies"
                raise InvalidInput(f"{who} {what}; only linear couplings of two joints are read")
            one, two, data = int(model.eq_obj1id[e]), int(model.eq_obj2id[e]), model.eq_data[e]
            if two < 0 or data[2:5].any():
                raise InvalidInput(
                    f"{who} is not linear in a second joint; polycoef 'c0 c1 0 0 0' and joint2 are "
                    "needed"
                )
            first, second = model.qpos0[model.jnt_qposadr[[one, two]]]
            followers[one] = {
                "joint": self.joints[two],
                "multiplier": repr(float(data[1])),
                "offset": repr(float(first + data[0] - data[1] * second)),
            }
        return followers

    def _add_fixed(self, root: ET.Element, links: tuple[str, str], placement: pin.SE3) -> None:
        parent, child = links
        name = child if child not in self.taken else _new_name(f"{child} fixed", self.taken)
        self.taken.add(name)
        joint = ET.SubElement(root, "joint", name=name, type="fixed")
        _add_origin(joint, placement)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)


def _new_name(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _matrix(quaternion: Sequence[float]) -> Array:
    w, x, y, z = quaternion
    return np.asarray(pin.Quaternion(w, x, y, z).normalized().matrix())


def _add_origin(element: ET.Element, placement: pin.SE3) -> None:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    numbers = {"xyz": number_text(placement.translation), "rpy": number_text(rpy)}
    ET.SubElement(element, "origin", numbers)
