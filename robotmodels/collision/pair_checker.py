"""Pairs of rigid shapes, compared in one configuration after the other."""

from collections.abc import Iterator, Sequence

import coal
import numpy as np
import pinocchio as pin

from robotmodels.collision.shapes import Shape
from robotmodels.common.arrays import Array, BoolArray

_TOUCHING = -1e-6
"""Margin for none [m]: at exactly 0 Coal's answers depend on what it compared before."""


class PairChecker:
    """Compares pairs of shapes by their hulls, and by their meshes where these touch.

    Parameters
    ----------
    rigid : pin.Model
        Moves the shapes.
    shapes : sequence of Shape
        Shapes on its joints.
    pairs : sequence of tuple of (int, int)
        Indices of the shapes that are compared.
    margin : float, m
        Distance below which two shapes count as touching.
    """

    def __init__(
        self,
        rigid: pin.Model,
        shapes: Sequence[Shape],
        pairs: Sequence[tuple[int, int]],
        margin: float,
    ) -> None:
        self.rigid, self.shapes, self.pairs = rigid, shapes, tuple(pairs)
        self.geometry = pin.GeometryModel()
        for i, shape in enumerate(shapes):
            name = f"{shape.link} {i}"
            item = pin.GeometryObject(name, shape.joint, 0, shape.placement, shape.hull)
            self.geometry.addGeometryObject(item)
        for i, j in self.pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(i, j))
        self.placed = pin.GeometryData(self.geometry)
        self.request = coal.CollisionRequest()
        for request in (*self.placed.collisionRequests, self.request):
            request.security_margin = margin or _TOUCHING

    def __call__(self, configured: Array) -> BoolArray:
        """Return which pairs touch, (Q, pairs), in configurations (Q, nq)."""
        touching = np.zeros((len(configured), len(self.pairs)), dtype=bool)
        data = self.rigid.createData()
        for k, q in enumerate(configured):
            if self.pairs and pin.computeCollisions(
                self.rigid, data, self.geometry, self.placed, q, False
            ):
                touching[k, list(self._confirmed())] = True
        return touching

    def always(self, configured: Array) -> list[int]:
        """Return the pairs that touch in every one of the configurations."""
        pairs, data = list(range(len(self.pairs))), self.rigid.createData()
        for q in configured:
            if not pairs:
                break
            pin.computeCollisions(self.rigid, data, self.geometry, self.placed, q, False)
            pairs = list(self._confirmed(pairs))  # meshes of others need not be compared
        return pairs

    def _confirmed(self, pairs: Sequence[int] | None = None) -> Iterator[int]:
        """Yield those of `pairs` whose hulls touch and, if both have one, their meshes."""
        results = self.placed.collisionResults
        for k in range(len(results)) if pairs is None else pairs:
            if results[k].isCollision() and (self._meshes_touch(k) is not False):
                yield k

    def _meshes_touch(self, pair: int) -> bool | None:
        """Return whether the surfaces of both meshes touch; None where there are not two."""
        i, j = self.pairs[pair]
        first, second = self.shapes[i].mesh, self.shapes[j].mesh
        if first is None or second is None:
            return None
        at = [coal.Transform3s(p.rotation, p.translation) for p in self._placements(i, j)]
        result = coal.CollisionResult()
        return bool(coal.collide(first, at[0], second, at[1], self.request, result))

    def _placements(self, i: int, j: int) -> tuple[pin.SE3, pin.SE3]:
        return self.placed.oMg[i], self.placed.oMg[j]
