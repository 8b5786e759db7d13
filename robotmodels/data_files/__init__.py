"""Files of data that users bring: each container is opened by one function and one guard.

A container (`hdf5_file`, `matlab_file`, `csv_table`, `universal_file`, `json_text`) knows its
library and turns what that raises over a damaged or hostile file into the package's error; it hands
on arrays that are described but not yet read. An `array_schema` says what a kind of file holds, so
that names, types, shapes and sizes are checked before anything large is read.
"""
