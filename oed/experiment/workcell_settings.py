"""The keys that say what stands around a robot: of candidates, and of experiments' ``workcell``.

`oed.study.settings.candidates_settings` shows them.
"""

from typing import Annotated, Self

from pydantic import Field, model_validator

from robotmodels.collision.obstacles import Box, Obstacle, Plane, Sphere
from robotmodels.collision.surroundings import Surroundings, surroundings
from robotmodels.common.yaml_files import FileSection
from robotmodels.description.ranges import Coordinate, Length, Vector
from robotmodels.elastic.robot import ElasticRobot


class ObstacleChoice(FileSection):
    """A plane (normal, offset), a box (center, size, rpy) or a sphere (center, radius)."""

    name: str
    normal: Vector | None = None
    offset: Coordinate | None = None
    center: Vector | None = None
    size: Vector | None = None
    rpy: Vector | None = None
    radius: Length | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        keys = self.model_fields_set - {"name"}
        shapes = ({"normal", "offset"}, {"center", "size"}, {"center", "radius"})
        if keys - {"rpy"} not in shapes or ("rpy" in keys and "size" not in keys):
            raise ValueError(
                f"obstacle {self.name!r}: {', '.join(sorted(keys)) or 'nothing'} given; a plane "
                "has normal and offset, a box center, size and rpy, a sphere center and radius"
            )
        return self

    @property
    def thing(self) -> Obstacle:
        """The plane, box or sphere."""
        if self.normal is not None and self.offset is not None:
            return Plane(self.name, self.normal, self.offset)
        center = self.center or (0.0, 0.0, 0.0)
        if self.size is not None:
            return Box(self.name, center, self.size, self.rpy or (0.0, 0.0, 0.0))
        return Sphere(self.name, center, self.radius or 0.0)


class WorkcellChoice(FileSection):
    """What the robot must not touch."""

    floor: Coordinate | None = None
    obstacles: Annotated[tuple[ObstacleChoice, ...], Field(max_length=1000)] = ()
    self_collision: bool | None = None
    link_radius: Length | None = None
    margin: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    ignored: tuple[tuple[str, str], ...] = ()

    @property
    def has_surroundings(self) -> bool:
        """Whether there is a floor or an obstacle."""
        return bool(self.obstacles) or self.floor is not None

    @property
    def compares_links(self) -> bool:
        """Whether links are compared with each other; by default where anything else is."""
        return self.has_surroundings if self.self_collision is None else self.self_collision

    @property
    def things(self) -> list[Obstacle]:
        """The obstacles."""
        return [choice.thing for choice in self.obstacles]


def surroundings_of(choice: WorkcellChoice, robot: ElasticRobot) -> Surroundings | None:
    """Return what a robot is compared with; None where nothing can be in its way.

    Raises
    ------
    InvalidInput
        As `robotmodels.surroundings`.
    """
    if not (choice.has_surroundings or choice.compares_links):
        return None
    return surroundings(
        robot,
        floor=choice.floor,
        obstacles=choice.things,
        self_collision=choice.compares_links,
        link_radius=choice.link_radius,
        margin=choice.margin,
        ignored=choice.ignored,
    )
