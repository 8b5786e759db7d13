"""The schema of a study of coupled chains: which chains, how they are measured and identified.

Chains move along a line or about an axis: read kg, N/m and m as kg m^2, N m/rad and rad in the
latter case.

    schema: chain_study/1
    seed: 1                      # of phases and noise
    chains:                      # a row for each chain, its motor's mass first
      masses: [[0.7, 2.0, 3.0], [4.0, 5.0, 6.0]]    # [kg]
      springs: [[1000.0, 2000.0], [3000.0, 4000.0]] # between the masses [N/m]
      couplings: {m3_6: 1.0}     # between last masses, counted along the rows [kg]
      dampers: [[0.2, 0.4], [0.6, 0.8]]    # parallel to the springs [N s/m]; none by default
    experiment:                  # run i moves motor i, position controllers hold the others
      multisine:                 # of the speed reference, keys as in an experiment file
        band: [0.1, 15.0]        # [Hz]
        sample_time: 0.002       # [s]
        period: 40.0             # [s]
      amplitude: 0.02            # per motor, of each line of the speed reference [m/s]
      blocks: 4                  # each with phases of its own, two at least
      periods: 2                 # measured in each run, two at least
      transient_periods: 1       # before them, not measured
      angle_noise: 2.0e-5        # per motor, standard deviation of what is measured [m]
      controller:                # torque -K_R theta - D theta' of the motors that are held
        stiffness: [500.0, 2500.0]    # K_R, per motor [N/m]
        damping: [60.0, 300.0]   # D, per motor [N s/m]
    compare_with: hovland_case_study    # left out, except to repeat the case study of that paper
    output: ../out/chains        # folder, relative to this file
"""

from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from oed.experiment.experiment_file import MultisineSettings
from oed.experiment.loop_settings import NonNegativeEach, PositiveEach, per_motor
from oed.experiment.settings_files import read_settings
from robotmodels.common.errors import check_word
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Coordinate, Positive, Seed
from robotmodels.linear.coupled_chains import CoupledChains
from robotmodels.simulation.controller import Controller

Rows = Annotated[list[Annotated[list[Positive], Field(min_length=1)]], Field(min_length=1)]


class ChainsChoice(FileSection):
    """Masses, springs, couplings and dampers of the chains that are simulated."""

    masses: Rows
    springs: Rows
    couplings: dict[str, Coordinate] = {}
    dampers: Rows | None = None

    @model_validator(mode="after")
    def _rows_alike(self) -> Self:
        for name in ("masses", "springs", "dampers"):
            rows = getattr(self, name) or []
            if len({len(row) for row in rows}) > 1:
                lengths = ", ".join(str(len(row)) for row in rows)
                raise ValueError(f"{name}: rows of {lengths} numbers; all must be equally long")
        return self


class HoldingController(FileSection):
    """Stiffness and damping of the position controllers, sampled as the torque is."""

    stiffness: PositiveEach
    damping: PositiveEach


class ChainExperiment(MultisineSettings):
    """How the chains are moved and measured, motor after motor."""

    amplitude: PositiveEach
    blocks: Annotated[int, Field(ge=2, le=1000)] = 2
    periods: Annotated[int, Field(ge=2, le=1000)] = 4
    angle_noise: NonNegativeEach = 0.0
    controller: HoldingController


class ChainStudy(FileSection):
    """A study of coupled chains, ``schema: chain_study/1``; paths are relative to the file."""

    schema_: Literal["chain_study/1"] = Field(alias="schema")
    seed: Seed = 1
    chains: ChainsChoice
    experiment: ChainExperiment
    compare_with: Literal["hovland_case_study"] | None = None
    output: Path

    @model_validator(mode="after")
    def _three_by_three(self) -> Self:
        shape = len(self.chains.masses), len(self.chains.masses[0])
        if self.compare_with is not None and shape != (3, 3):
            raise ValueError(
                f"compare_with: the case study has 3 chains of 3 masses, this file {shape[0]} of "
                f"{shape[1]}; leave it out"
            )
        return self


def load_chain_study(path: str | Path) -> ChainStudy:
    """Read a study of coupled chains, see `read_settings`."""
    return read_settings(path, ChainStudy)


def study_chains(choice: ChainsChoice) -> CoupledChains:
    """Return the chains of a study file.

    Raises
    ------
    InvalidInput
        If shapes do not fit, a coupling has no such name, or the mass matrix is not positive
        definite.
    """
    masses = np.array(choice.masses)
    count, length = masses.shape
    pairs = {
        f"m{length * (i + 1)}_{length * (j + 1)}": (i, j)
        for i in range(count)
        for j in range(i + 1, count)
    }
    couplings = np.zeros((count, count))
    for name, value in choice.couplings.items():
        check_word("chains.couplings:", name, pairs, "does not name two last masses")
        couplings[pairs[name]] = couplings[pairs[name][::-1]] = value
    dampers = None if choice.dampers is None else np.array(choice.dampers)
    return CoupledChains(masses, np.array(choice.springs), couplings, dampers)


def study_controller(experiment: ChainExperiment, motors: tuple[str, ...]) -> Controller:
    """Return the position controllers of a study file.

    Raises
    ------
    InvalidInput
        If a list has not one entry per motor.
    """
    stiffness, damping = (
        per_motor(f"experiment.controller.{name}", value, motors)
        for name, value in (
            ("stiffness", experiment.controller.stiffness),
            ("damping", experiment.controller.damping),
        )
    )
    endless = np.full(len(motors), np.inf)  # no integral part
    return Controller(damping, endless, stiffness / damping, experiment.multisine.sample_time)
