"""Surfaces with few enough triangles for a picture."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robotmodels.collision.surfaces import LinkSurface
from robotmodels.common.arrays import IntArray

_FIRST, _COARSER = 0.01, 1.15  # first cell, over the largest extent of a link, and its growth


def simplified_surfaces(surfaces: Sequence[LinkSurface], most: int) -> tuple[LinkSurface, ...]:
    """Return surfaces with at most `most` triangles together, outward ones counter-clockwise.

    Corners in one cell of a grid become one, their mean; triangles that vanish are left out
    (Rossignac and Borrel 1993). The cells are as small as `most` allows.

    Parameters
    ----------
    surfaces : sequence of LinkSurface
        As of `link_surfaces`.
    most : int
        Triangles; of each surface some tens may remain.
    """
    shown = [_outward(one) for one in surfaces]
    largest = max((float(np.ptp(one.vertices, axis=0).max()) for one in shown), default=1.0)
    clustered, cell = shown, _FIRST * largest
    while sum(len(one.faces) for one in clustered) > most and cell < largest:
        clustered = [_clustered(one, cell) for one in shown]
        cell *= _COARSER
    return tuple(clustered)


def _clustered(surface: LinkSurface, cell: float) -> LinkSurface:
    """Return the surface with corners in one cell merged, in at least two cells each way."""
    low, extent = surface.vertices.min(axis=0), np.ptp(surface.vertices, axis=0)
    cells = np.maximum(np.rint(extent / cell), 1) + 1  # thin links stay solid
    bins = np.rint((surface.vertices - low) / np.where(extent > 0, extent, 1.0) * (cells - 1))
    _, members, counts = np.unique(bins, axis=0, return_inverse=True, return_counts=True)
    members = members.reshape(-1)
    sums = [np.bincount(members, column) for column in surface.vertices.T]
    return replace(
        surface,
        vertices=np.stack(sums, axis=1) / counts[:, None],
        faces=_solid(members[surface.faces]),
    )


def _solid(faces: IntArray) -> IntArray:
    """Return triangles of three different corners, none twice."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    first = np.argmin(faces, axis=1)
    turned = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return np.unique(turned, axis=0)


def _outward(surface: LinkSurface) -> LinkSurface:
    """Return the surface so turned that the volume it encloses is positive."""
    corners = surface.vertices - surface.vertices.mean(axis=0)
    a, b, c = (corners[surface.faces[:, k]] for k in range(3))
    inside_out = float(np.sum(a * np.cross(b, c))) < 0
    return replace(surface, faces=surface.faces[:, ::-1]) if inside_out else surface
