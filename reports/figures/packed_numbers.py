"""Arrays as short text: steps, differences, bytes of equal weight together, deflated.

``packed.js`` undoes it.
"""

import base64
import zlib
from typing import Any

import numpy as np

from robotmodels.common.arrays import Array


def packed(values: Array, step: float, order: int) -> dict[str, Any]:
    """Return (Q, F, ...) in steps, with `order` differences along frequency, which comes last."""
    whole = np.rint(np.moveaxis(values, 1, -1) / step).astype(np.int32)
    for _ in range(order):
        whole = np.diff(whole, axis=-1, prepend=np.int32(0))
    unsigned = (whole << 1) ^ (whole >> 31)  # small numbers of either sign have zeros in front
    planes = unsigned.astype("<i4").reshape(-1, 1).view(np.uint8).T
    deflate = zlib.compressobj(6, zlib.DEFLATED, 15, 9, zlib.Z_FILTERED)
    packed = base64.b64encode(deflate.compress(planes.tobytes()) + deflate.flush()).decode()
    return {"step": step, "order": order, "bytes": packed}
