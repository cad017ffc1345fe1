"""No mark that was to be replaced is left in a document."""

import pathlib
import re

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = [*sorted((ROOT / "docs").glob("*.md")), *sorted(ROOT.glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_mark_is_left(page):
    assert not re.findall(r"@[A-Z][A-Z0-9]*@|\bTODO\b|\bFIXME\b|\bXXX\b", page.read_text())
