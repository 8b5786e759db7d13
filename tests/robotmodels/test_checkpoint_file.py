"""What is kept of unfinished work is used as it was written, or not at all."""

import numpy as np
import pytest

from robotmodels.common.checkpoint_file import CheckpointFile, UnusableCheckpoint

VALUES = np.random.default_rng(0).normal(size=(7, 3))


def checkpoint(path, fingerprint="one", kind="numbers"):
    return CheckpointFile(path, fingerprint, kind, "other numbers")


def written(path):
    with checkpoint(path).writing() as file:
        file["values"] = VALUES
        file.attrs["name"] = "seven"
    return path


def read(path):
    with checkpoint(path).reading() as file:
        return file["values"][:]


def test_it_is_read_as_it_was_written(tmp_path):
    path = written(tmp_path / "n.h5")
    assert (read(path) == VALUES).all()
    assert [p.name for p in tmp_path.iterdir()] == ["n.h5"]


def test_any_flipped_bit_is_noticed(tmp_path):
    path = written(tmp_path / "n.h5")
    whole = bytearray(path.read_bytes())
    rng = np.random.default_rng(1)
    # All of the header, and a sample of what follows.
    places = [*range(8 * 512), *rng.integers(8 * 512, 8 * len(whole), 500)]
    for place in places:
        flipped = whole.copy()
        flipped[place // 8] ^= 1 << place % 8
        path.write_bytes(flipped)
        with pytest.raises(UnusableCheckpoint, match=r"n\.h5: .*(as it was written|is needed)"):
            read(path)


@pytest.mark.parametrize("content", ["", "{}", "[" * 100_000, '{"schema": 1}', "null"])
def test_what_is_none_is_refused_with_the_remedy(tmp_path, content):
    path = tmp_path / "n.h5"
    path.write_text(content)
    with pytest.raises(UnusableCheckpoint, match="remove it and run the same again"):
        read(path)


def test_cut_or_lengthened_it_is_refused(tmp_path):
    path = written(tmp_path / "n.h5")
    whole = path.read_bytes()
    for wrong in (whole[:-1], whole[:512], whole[:100], whole + b"\0"):
        path.write_bytes(wrong)
        with pytest.raises(UnusableCheckpoint):
            read(path)


def test_a_folder_in_its_place_is_refused(tmp_path):
    with pytest.raises(UnusableCheckpoint):
        read(tmp_path)


def test_other_work_is_refused_by_name(tmp_path):
    path = written(tmp_path / "n.h5")
    with (
        pytest.raises(UnusableCheckpoint, match="holds other numbers"),
        checkpoint(path, "two").reading(),
    ):
        pass
    with (
        pytest.raises(UnusableCheckpoint, match="'numbers/1'; 'words/1' is needed"),
        checkpoint(path, kind="words").reading(),
    ):
        pass
