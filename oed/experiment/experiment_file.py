"""The schema of an experiment file: robot, positions, excitation.

Angles are in rad, as in a study file; torques, speeds, angles of encoders and controllers are those
of the motor shafts, positions and swings motor angles divided by gear ratios (m for a prismatic
joint). Where a key is "per motor", one number serves all motors and a list has one for each.

    schema: experiment/1
    robot: manutec_r3            # a built-in robot, or the path of a robot file
    positions:                   # where to measure, one angle per motor, in this order
      - [0.0, 0.5, -0.8, 0.0, 0.6, 0.0]
    repetitions: [2]             # experiments in each; one by default
    runs: 6                      # of a block; as many as motors by default, which FRFs need, fewer
                                 # for `oed identify`
    # design: ../out/r3/design.json    in place of positions and repetitions: those of a study
    multisine:
      band: [1.0, 50.0]          # [Hz]
      sample_time: 0.001         # [s]
      period: 1.0                # [s], a whole number of samples; lines are 1/period apart
      count: 40                  # lines to spread over the band; all by default
      spacing: quasi_log         # linear (default) or quasi_log, which needs a count
      odd: true                  # odd lines only (default), so that even distortion shows
      detection: 4               # one line in every four, at random, is left out to show odd
                                 # distortion; none by default
      slope: 0.0                 # the speed's amplitude goes with frequency to this power
      crest_iterations: 0        # 200 lowers the crest factor; 0 leaves the phases random
    blocks: 4                    # per experiment, each with phases of its own
    periods: 2                   # measured in each experiment
    transient_periods: 1         # before them, not measured
    ramp: true                   # the first of those rises from rest (default), which leaves room
                                 # for larger amplitudes; where there is none, nothing rises
    limits:                      # at least one; amplitudes are the largest that they allow
      torque: [8, 8, 8, 2, 2, 1] # peak per motor, holding torque included [N m]
      rms_torque: 5.0            # root mean square per motor, holding torque included [N m]: the
                                 # continuous torque of the data sheet, which heat sets
      speed: 300.0               # peak per motor [rad/s]
      swing: 0.05                # peak deviation from the position, per motor [rad]
      command_speed: 320.0       # of the speed reference, per motor [rad/s]: above it a controller
                                 # would refuse it
      command_acceleration: 2.0e4    # of the reference, sample to sample, per motor [rad/s^2]
      margin: 0.1                # part of each limit to stay away from it; 0 by default
      balance: true              # whether inputs' ratios are chosen so that each meets a limit
    moves: {speed: 1.0, acceleration: 2.0}    # between positions, per motor [rad/s, rad/s^2]
    settle: 0.0                  # rest after a move, before the first run [s]
    carrier:                     # slow sines under the excitation; none by default
      speed: 20.0                # of the motors, their amplitudes, per motor [rad/s]
      frequency: 0.5             # below the band, a multiple of 1/period [Hz]; twice it if left out
    controller:                  # left out: default gains, stable for this robot
      speed_gain: 0.5            # per motor [N m s/rad]
      integral_time: 0.05        # per motor [s]
      position_gain: 5.0         # per motor [1/s]
      filter_time: 0.0           # per motor, of the speed's low-pass filter [s]; 0 by default
    imperfections:               # left out: none but the robot file's friction
      friction: 1.0              # factor of the robot file's Coulomb friction; 1 by default
      backlash: 0.0              # per motor, from flank to flank [rad, arm side]
      quantisation: 0.0          # resolution of the measured angles [rad]
      angle_noise: 1.0e-6        # per motor, standard deviation on the measured angles [rad]
      output_noise: 0.0          # per output of the robot file but motors' encoders [its unit]
      torque_disturbance: 0.0    # per motor, standard deviation, unseen by the records [N m]
      torque_limit: 9.0          # per motor [N m]; none by default
      nonlinear_gears: true      # whether hardening springs harden (default)
    workcell: {floor: 0.0}       # moves and swings must not touch it, each other or obstacles; keys
                                 # as in a study's candidates; nothing is checked by default
    files: [csv, mat, trajectory]    # for a controller, in output/controller; none by default
    seed: 1
    output: ../out/r3_experiment # folder; it, robot and design are relative to this file
"""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from oed.experiment.design_file import designed_positions
from oed.experiment.loop_settings import Format, LoopSettings, MultisineChoice
from oed.experiment.settings_files import read_settings
from oed.experiment.workcell_settings import WorkcellChoice
from robotmodels.common.arrays import Array, IntArray
from robotmodels.common.errors import InvalidInput
from robotmodels.common.file_paths import absolute
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Coordinate, Count, Seed

MOST_SAMPLES = 10_000_000
"""Samples of a run of all blocks and periods: an hour at 2.8 kHz."""


class MultisineSettings(FileSection):
    """Multisine of each run, and how often it is repeated."""

    multisine: MultisineChoice
    blocks: Count = 4
    periods: Count = 2
    transient_periods: Annotated[int, Field(ge=0, le=1000)] = 1

    @model_validator(mode="after")
    def _not_too_long(self) -> Self:
        periods = self.blocks * (self.periods + self.transient_periods)
        if periods * self.multisine.samples > MOST_SAMPLES:
            raise ValueError(
                f"blocks, periods: {periods} periods of {self.multisine.samples} samples in all; "
                f"at most {MOST_SAMPLES} samples can be measured in one go"
            )
        return self


class ExcitationSettings(MultisineSettings, LoopSettings):
    """Excitation of a robot in its positions: the keys that a study's ``experiment`` has too."""

    runs: Annotated[int, Field(ge=0, le=64)] = 0  # of a block; 0 for as many as motors
    ramp: bool = True


class Experiment(ExcitationSettings):
    """An experiment file, ``schema: experiment/1``; its paths are relative to the file."""

    schema_: Literal["experiment/1"] = Field(alias="schema")
    robot: str
    positions: Annotated[list[list[Coordinate]], Field(min_length=1)] | None = None
    repetitions: list[Count] | None = None
    design: Path | None = None
    files: tuple[Format, ...] = ()
    workcell: WorkcellChoice = WorkcellChoice()
    seed: Seed = 1
    output: Path

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.positions is None) == (self.design is None):
            number = "neither" if self.design is None else "both"
            raise ValueError(f"{number} of positions and design given; one of them is needed")
        if self.design is not None and self.repetitions is not None:
            raise ValueError("repetitions: the design has its own; leave them out")
        if self.repetitions is not None and self.positions is not None:
            r, q = len(self.repetitions), len(self.positions)
            if r != q:
                raise ValueError(f"repetitions: {r} given for {q} positions; one each is needed")
        return self


def load_experiment(path: str | Path) -> Experiment:
    """Read an experiment file, see `read_settings`; the path of a design becomes absolute too."""
    experiment = read_settings(path, Experiment)
    design = experiment.design and absolute(Path(path).resolve().parent, experiment.design)
    return experiment.model_copy(update={"design": design})


def planned_positions(experiment: Experiment, robot: str) -> tuple[Array, IntArray]:
    """Return positions (Q, n) [rad] and experiments in each (Q,), from the file or its design.

    Parameters
    ----------
    robot : str
        Name of the robot, which a design must be for.

    Raises
    ------
    InvalidInput
        If positions differ in length, or the design cannot be used.
    """
    if experiment.design is not None:
        return designed_positions(experiment.design, robot)
    rows = experiment.positions or []
    for i, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise InvalidInput(f"positions[{i}]: {len(row)} angles, positions[0] {len(rows[0])}")
    repetitions = experiment.repetitions or [1] * len(rows)
    return np.array(rows, dtype=float), np.array(repetitions, dtype=np.int64)
