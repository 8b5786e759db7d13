"""What files of records hold."""

from dataclasses import replace

from robotmodels.data_files.array_schema import ArraySchema, Field
from robotmodels.description.ranges import MOST_LENGTH

RECORDS_SCHEMA = "records/1"
NEEDED = "records are"
_RUNS = ("block", "run", "period", "sample")
_COMMON = {
    "sample_time": Field(attribute=True),
    "lines": Field(("line",), "whole", least=1),
    "detection": Field(("detection line",), "whole", least=1),
    "derivatives": Field(("output",), "whole", least=0, most=2, optional=True),
}
_COORDINATES = Field(("motor",), least=-MOST_LENGTH, most=MOST_LENGTH)
# Runs that are missing have NaN, of which `Records` itself takes care.
_SIGNAL_FIELDS = {
    "torque": Field((*_RUNS, "motor"), finite=False),
    "command": Field((*_RUNS, "motor"), finite=False, optional=True),
    "angle": Field((*_RUNS, "output"), finite=False),
    "reference": Field(("block", "run", "period or 1", "sample", "motor")),
    "saturated": Field(("block", "run", "period", "motor"), "truth"),
}
# Of files that hold all positions in one array; HDF5 has a group for each.
RECORDS = ArraySchema(
    {
        **_COMMON,
        "positions": replace(_COORDINATES, axes=("position", "motor")),
        **{
            name: replace(field, axes=("position", *field.axes))
            for name, field in _SIGNAL_FIELDS.items()
        },
    }
)
