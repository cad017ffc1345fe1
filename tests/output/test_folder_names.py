"""Names of result folders: inside their parent, and one for each file, whatever the files are called."""

from pathlib import Path

from hypothesis import example, given
from hypothesis import strategies as st

from fpjax.output.folder_names import folder_names


@given(st.lists(st.text(max_size=120), max_size=12))
@example(["...csv", "..", ".", "", "/", "\\", "a/../..", "..csv.csv"])
@example(["a.csv", "a-1.csv", "a.mat", "A.csv", "a-2"])
@example(["con.csv", "NUL", "com1.x.csv", "x" * 300])
def test_no_name_leaves_its_parent_and_none_repeats(files):
    names = folder_names(files)
    assert len(names) == len(files)
    assert len({name.casefold() for name in names}) == len(names)
    parent = Path("parent")
    for name in names:
        assert name
        assert name == name.strip(" .")
        assert Path(name).name == name  # one part, no "..", no drive
        assert (parent / name).resolve().parent == parent.resolve()
        assert not any(char in name for char in '/\\:*?"<>|\0')
        assert len(name) < 100


def test_common_names_are_kept():
    assert folder_names(["monday.csv", "run 2 (b).mat"]) == ["monday", "run 2 (b)"]
    assert folder_names(["a.csv", "b.csv", "a.mat"]) == ["a-1", "b", "a-2"]
