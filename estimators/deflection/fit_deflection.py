"""Stiffnesses of gears from encoders on both sides, in slow or ordinary movements."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from estimators.deflection.assumptions import (
    DeflectionAssumptions,
    SystematicTerm,
    systematic_terms,
)
from estimators.deflection.axis_deflection import (
    AxisDeflection,
    DeflectionHistory,
    RecordEstimate,
    deflection_history,
    estimate,
    sprung,
)
from estimators.deflection.explained_share import explained_share
from estimators.deflection.joint_movement import JointHistories, JointMovement, joint_movement
from estimators.deflection.load_balance import moves, tells_weight
from estimators.deflection.missing_terms import MissingTerm, missing_terms
from estimators.trust.intervals import Interval, Verdict
from robotmodels.common.arrays import Array
from robotmodels.common.errors import InvalidInput, check_word
from robotmodels.elastic.robot import ElasticRobot

_HALF_WIDTH = 3**-0.5  # standard deviation of a uniform distribution of half-width 1


@dataclass(frozen=True, eq=False)
class DeflectionFit:
    """Estimates from records with encoders on both sides of the gears.

    Attributes
    ----------
    start : ElasticRobot
        The robot as it was given.
    at : DeflectionAssumptions
        What was taken for granted.
    estimate : RecordEstimate
        Payload, friction, compliances and delays, with residuals.
    systematic : dict of str to ndarray
        By name, how far each assumption moves `estimate.results`.
    missing : tuple of MissingTerm
        What was looked for in the residuals.
    conditional : bool
        Whether the payload was taken from the robot file: stiffnesses go with it.
    """

    start: ElasticRobot
    at: DeflectionAssumptions
    estimate: RecordEstimate
    systematic: Mapping[str, Array]
    missing: tuple[MissingTerm, ...]
    conditional: bool

    def intervals(self) -> tuple[Interval, ...]:
        """Return 95 % intervals of stiffnesses, delays, payload and friction, SI units.

        Their ends include noise and the systematic terms, each as a uniform distribution.
        """
        axes = self.estimate.axes
        stiffnesses = [self._stiffness(i, axis) for i, axis in enumerate(axes)]
        delays = [each for i, axis in enumerate(axes) for each in self._delays(i, axis)]
        loads = [self._payload()] if self.estimate.file_payload is None else []
        return (*stiffnesses, *self._at_rest(), *delays, *loads, *self._friction())

    def systematic_shifts(self) -> dict[str, dict[str, float]]:
        """Return, by term and parameter, the relative shift of stiffnesses and payload."""
        estimated = ["payload.mass"] if self.estimate.file_payload is None else []
        names = [*(self._spring(axis) for axis in self.estimate.axes), *estimated]
        indices = [*range(len(self.estimate.axes)), -1][: len(names)]
        results = self.estimate.results
        signs = np.array([*(-1.0 for _ in self.estimate.axes), *(1.0 for _ in estimated)])
        return {
            term: dict(
                zip(names, (signs * shift[indices] / results[indices]).tolist(), strict=True)
            )
            for term, shift in self.systematic.items()
        }

    def robot(self) -> ElasticRobot:
        """Return the robot with the stiffnesses that were identified, and the payload."""
        values = {i.name: i.value for i in self.intervals() if i.verdict.gives_interval}
        springs = [
            spring.model_copy(update={"stiffness": values[f"{spring.name}.stiffness"]})
            if f"{spring.name}.stiffness" in values
            else spring
            for spring in self.start.file.springs
        ]
        update: dict[str, object] = {"springs": springs}
        if self.start.file.payload is not None and "payload.mass" in values:
            mass = {"mass": values["payload.mass"]}
            update["payload"] = self.start.file.payload.model_copy(update=mass)
        return ElasticRobot(self.start.file.model_copy(update=update), self.start.folder)

    def explained_share(self, record: JointHistories, *, centred: bool = False) -> dict[str, float]:
        """Return, for each gear, the share of the spring's part of another record's deflection.

        1 - |d - d'|^2 / |d|^2 over moving samples: d is the deflection less offset, delay and
        hysteresis, which are fitted to that record, d' the gear's torque over the stiffness. Both
        hold the mean load, unless they are `centred`: an offset absorbs any mean. Gears whose
        compliance is negative are left out.
        """
        movement = joint_movement(self.start, record)
        shares = explained_share(self.estimate, self.at, movement, centred)
        pairs = zip(self.estimate.axes, shares, strict=True)
        return {self._spring(axis): share for axis, share in pairs if axis.compliance > 0}

    @property
    def verdict(self) -> Verdict:
        """The verdict on all stiffnesses: what is missing, else how many have an interval."""
        stiffnesses = [one for one in self.intervals() if one.name.endswith(".stiffness")]
        told = sum(one.verdict.gives_interval for one in stiffnesses)
        if self.flags:
            return Verdict("model error", self.flags[0].sentence)
        if not told:
            return Verdict("not identifiable", "the movements tell no stiffness")
        return Verdict("trustworthy", f"{told} of {len(stiffnesses)} stiffnesses have an interval")

    @property
    def gears(self) -> tuple[str, ...]:
        """Names of the stiffnesses that were fitted: those of gears that moved."""
        return tuple(self._spring(axis) for axis in self.estimate.axes)

    def histories(self, spring: str) -> tuple[DeflectionHistory, ...]:
        """Return measured and fitted deflections of a gear, record by record.

        Parameters
        ----------
        spring : str
            Name of its stiffness, such as ``g2.stiffness``.

        Raises
        ------
        InvalidInput
            If no such stiffness was fitted.
        """
        check_word("spring", spring, self.gears, "was not fitted")
        axis, records = self.estimate.axes[self.gears.index(spring)], len(self.estimate.smooth)
        return tuple(deflection_history(self.estimate, self.at, axis, r) for r in range(records))

    def _spring(self, axis: AxisDeflection) -> str:
        return self._stiffness_name(axis.motor)

    def _stiffness_name(self, motor: int) -> str:
        spring = self.start.layout.drive_springs[motor]
        assert spring is not None  # axes are those with one
        return f"{self.start.file.springs[spring].name}.stiffness"

    def _at_rest(self) -> list[Interval]:
        """Return the stiffnesses of gears whose joints hardly move."""
        told, movement = (
            {axis.motor for axis in self.estimate.axes},
            self.estimate.smooth[0].measured,
        )
        reason = f"its joint hardly moves faster than {self.at.least_speed:g} rad/s"
        verdict = Verdict("not identifiable", reason)
        return [
            Interval(
                self._stiffness_name(j), np.nan, np.inf, None, None, "deflection", 0.0, verdict
            )
            for j in sprung(movement)
            if j not in told
        ]

    def _total_std(self, index: int, noise: float, dof: float) -> tuple[float, float]:
        """Return the standard deviation with the systematic terms, and its degrees of freedom."""
        shifts = np.array([shift[index] for shift in self.systematic.values()])
        total = float(np.sqrt(noise**2 + np.sum((_HALF_WIDTH * shifts) ** 2)))
        return total, dof * (total / noise) ** 4 if noise else np.inf  # Welch and Satterthwaite

    def _stiffness(self, i: int, axis: AxisDeflection) -> Interval:
        c, regression = axis.compliance, axis.regression
        std, dof = self._total_std(i, regression.std(0), regression.degrees_of_freedom)
        half = float(stats.t.ppf(0.975, dof)) * std
        verdict = self._verdict(axis, c - half > 0)
        low, high = (1 / (c + half), 1 / (c - half)) if verdict.gives_interval else (None, None)
        value, std = 1 / c, abs(std / c**2)
        return Interval(self._spring(axis), value, std, low, high, "deflection", dof, verdict)

    def _verdict(self, axis: AxisDeflection, identified: bool) -> Verdict:
        mdeg = np.degrees([axis.elastic, axis.regression.rms]) * 1e3
        evidence = (
            f"the spring's part is {mdeg[0]:.2g} mdeg, the residual {mdeg[1]:.2g}, "
            f"{axis.regression.effective_samples:.0f} effective samples"
        )
        if axis.compliance <= 0:
            return Verdict("not identifiable", f"the records say nothing on it: {evidence}")
        motor = self.start.motor_names[axis.motor]
        if flagged := [term for term in self.flags if term.motor == motor]:
            return Verdict("model error", flagged[0].sentence)
        if not identified:
            return Verdict("not identifiable", f"no upper end of the stiffness: {evidence}")
        payload = self.start.file.payload
        mass = f"; for a payload of {payload.mass:g} kg" if payload and self.conditional else ""
        return Verdict("trustworthy", evidence + mass)

    @property
    def flags(self) -> tuple[MissingTerm, ...]:
        """What is missing from the model and matters, the largest first."""
        flags = [term for term in self.missing if term.matters]
        return tuple(sorted(flags, key=lambda term: -term.share))

    def _delays(self, i: int, axis: AxisDeflection) -> list[Interval]:
        if not self.at.delays:
            return []
        count, first = len(axis.delays), len(self.estimate.axes)
        name = f"{self.start.motor_names[axis.motor]}.delay"
        intervals = []
        for r, (value, noise) in enumerate(zip(axis.delays, axis.delays_std, strict=True)):
            index = first + i * count + r
            label = name if count == 1 else f"{name} in record {r + 1}"
            dof = axis.regression.degrees_of_freedom
            verdict = Verdict("trustworthy", "of the link's encoder behind the motor's")
            intervals.append(self._symmetric(label, float(value), index, noise, dof, verdict))
        return intervals

    def _symmetric(
        self, name: str, value: float, index: int, noise: float, dof: float, verdict: Verdict
    ) -> Interval:
        std, dof = self._total_std(index, noise, dof)
        half = float(stats.t.ppf(0.975, dof)) * std
        low, high = (value - half, value + half) if verdict.gives_interval else (None, None)
        return Interval(name, value, std, low, high, "deflection", dof, verdict)

    def _payload(self) -> Interval:
        value, noise = self.estimate.payload, self.estimate.payload_std
        each = [b for b in self.estimate.balances if b.with_payload]
        dof = sum(b.regression.degrees_of_freedom for b in each)
        motors = [self.start.motor_names[b.motor] for b in each]
        verdict = Verdict("trustworthy", f"from the torques of {', '.join(motors)}")
        if flagged := [t for t in self.flags if t.signal == "torque" and t.motor in motors]:
            verdict = Verdict("model error", flagged[0].sentence)
        elif value <= 2 * self._total_std(-1, noise, dof)[0]:
            verdict = Verdict("not identifiable", "zero is within the interval")
        return self._symmetric("payload.mass", value, -1, noise, dof, verdict)

    def _friction(self) -> list[Interval]:
        intervals = []
        for balance in self.estimate.balances:
            motor = self.start.file.motors[balance.motor]
            first, dof = int(balance.with_payload), balance.regression.degrees_of_freedom
            scales = abs(motor.gear_ratio), motor.gear_ratio**2
            for k, (entry, scale) in enumerate(zip(("coulomb", "viscous"), scales, strict=True)):
                value, std = balance.friction[k] / scale, balance.regression.std(first + k) / scale
                half = float(stats.t.ppf(0.975, dof)) * std
                verdict = Verdict("trustworthy", "from the motor's torque; noise only")
                if value - half <= 0:
                    verdict = Verdict("not identifiable", "zero is within the interval")
                intervals.append(
                    Interval(
                        f"{motor.name}.{entry}",
                        value,
                        std,
                        value - half if verdict.gives_interval else None,
                        value + half if verdict.gives_interval else None,
                        "motor torque",
                        dof,
                        verdict,
                    )
                )
        return intervals


def fit_deflection(
    robot: ElasticRobot,
    records: JointHistories | Sequence[JointHistories],
    *,
    payload: Literal["estimated", "robot file"] = "estimated",
    assumptions: DeflectionAssumptions | None = None,
    systematic: Sequence[SystematicTerm] | None = None,
) -> DeflectionFit:
    """Fit stiffnesses, delays, payload and friction to movements with encoders on both sides.

    Parameters
    ----------
    robot : ElasticRobot
        The robot; its drive springs, payload and friction need not be known.
    records : JointHistories or sequence of them
        Movements, such as `robotmodels.Movement`; several are pooled, offsets and delays of the
        encoders free in each. A joint's torque sensor (``joint_torque`` of a movement) takes the
        place of what its gear bears by the robot's masses and its payload.
    payload : {"estimated", "robot file"}
        Whether the payload's mass comes from the motor torques of the same records, or from the
        robot file, of which the stiffnesses then are conditional: deflections alone give stiffness
        over load.
    assumptions : DeflectionAssumptions, optional
        Filter, least speed, delays and so on.
    systematic : sequence of SystematicTerm, optional
        Systematic terms of the intervals; by default those of `systematic_terms`.

    Raises
    ------
    InvalidInput
        If records do not fit the robot, no joint with encoders on both sides has a drive spring, or
        nothing tells the payload.
    """
    at = DeflectionAssumptions() if assumptions is None else assumptions
    many = records if isinstance(records, Sequence) else [records]
    movements = [joint_movement(robot, record) for record in many]
    if not movements or not sprung(movements[0]):
        raise InvalidInput("records: no joint with encoders on both sides has a drive spring")
    _check_alike(movements)
    mass = _file_payload(robot, movements, at, payload)
    here = estimate(movements, at, mass)
    if not here.axes:
        raise InvalidInput(
            f"records: no joint with encoders on both sides moves faster than {at.least_speed:g} "
            "rad/s for long enough; move it, or lower least_speed"
        )
    shifts = {
        variation.name: _shift(movements, variation, here, mass)
        for variation in (systematic_terms(at) if systematic is None else systematic)
    }
    missing = missing_terms(here, at)
    conditional = mass is not None and robot.file.payload is not None
    conditional = conditional and not _all_sensed(movements)
    return DeflectionFit(robot, at, here, shifts, missing, conditional)


def _file_payload(
    robot: ElasticRobot, movements: Sequence[JointMovement], at: DeflectionAssumptions, payload: str
) -> float | None:
    """Return the payload's mass where it is not estimated.

    Raises
    ------
    InvalidInput
        If it is to be estimated and nothing tells it.
    """
    check_word("payload:", payload, ("estimated", "robot file"))
    file = robot.file.payload
    if file is None or payload == "robot file":
        return 0.0 if file is None else file.mass
    silent = any(movement.torque is None for movement in movements)
    if silent and _all_sensed(movements):
        return file.mass
    remedy = (
        "deflections alone give stiffness over load; record motor torques too, or choose "
        "payload='robot file', for which the stiffnesses then hold"
    )
    if silent:
        raise InvalidInput(f"motor_torque is missing, so the payload is not identifiable: {remedy}")
    smooth = [movement.low_passed(at.low_pass) for movement in movements]
    torques = [s.torques(np.zeros(len(robot.motor_names))) for s in smooth]
    both = [np.isfinite(m.torque).all(axis=0) for m in movements if m.torque is not None]
    measured = np.flatnonzero(np.all([*both, movements[0].on_both_sides], axis=0))
    if not any(tells_weight(torques, int(j)) and moves(smooth, int(j), at) for j in measured):
        raise InvalidInput(f"no motor torque shows the payload's weight: {remedy}")
    return None


def _all_sensed(movements: Sequence[JointMovement]) -> bool:
    """Return whether torque sensors tell the torques of all gears."""
    gears = sprung(movements[0])
    return all(bool(movement.senses_torque[gears].all()) for movement in movements)


def _check_alike(movements: Sequence[JointMovement]) -> None:
    first = movements[0]
    for i, movement in enumerate(movements[1:], start=2):
        if not np.array_equal(movement.on_both_sides, first.on_both_sides):
            raise InvalidInput(f"record {i}: encoders behind other gears than in record 1")


def _shift(
    movements: Sequence[JointMovement],
    variation: SystematicTerm,
    here: RecordEstimate,
    mass: float | None,
) -> Array:
    """Return the change of the results that is largest among a term's alternatives."""
    others = [estimate(movements, at, mass, here) for at in variation.alternatives]
    shifts = [other.results - here.results for other in others]
    largest = np.argmax(np.abs(shifts), axis=0)
    return np.asarray(np.take_along_axis(np.array(shifts), largest[None], axis=0)[0])
