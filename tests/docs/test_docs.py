"""The documentation is complete: every public symbol is on an API page, and says what its arguments are."""

import inspect
import pathlib
import re

import pytest

import fpjax
import tuning

ROOT = pathlib.Path(__file__).parents[2]
PAGES = {page: page.read_text() for page in (ROOT / "docs").rglob("*.md")}
DOCUMENTED = {
    module for text in PAGES.values() for module in re.findall(r"^\.\. automodule:: (\S+)", text, flags=re.MULTILINE)
}
PUBLIC = [
    (package.__name__, name, value)
    for package, names in ((fpjax, dir(fpjax)), (tuning, vars(tuning)))
    for name in names
    if not name.startswith("_") and (inspect.isclass(value := getattr(package, name)) or inspect.isfunction(value))
]
IDS = [f"{package}.{name}" for package, name, _ in PUBLIC]


@pytest.mark.parametrize(("package", "name", "value"), PUBLIC, ids=IDS)
def test_public_symbol_is_on_an_api_page(package, name, value):
    del package, name
    assert value.__module__ in DOCUMENTED


@pytest.mark.parametrize(("package", "name", "value"), PUBLIC, ids=IDS)
def test_public_symbol_says_what_its_arguments_are(package, name, value):
    del package
    text = inspect.getdoc(value) or ""
    assert text, f"{name} has no docstring"
    if inspect.isclass(value):
        # Its own fields, and those of the data that a result is: `Diagnosis` has the fields of `Answer`.
        told = {value: vars(value).get("__annotations__", {})}
        told |= {base: base.__annotations__ for base in value.__bases__ if base.__name__ == "Answer"}
        text += "".join(inspect.getdoc(base) or "" for base in told if base is not value)
        fields = [
            field
            for each in told.values()
            for field, kind in each.items()
            if not field.startswith("_") and "ClassVar" not in str(kind)
        ]
        text += inspect.getdoc(value.__init__) or "" if "__init__" in vars(value) else ""
        is_abstract = inspect.isabstract(value)
        missing = [] if is_abstract or issubclass(value, Exception) else [f for f in fields if not _named(text, f)]
    else:
        missing = [p for p in inspect.signature(value).parameters if not _named(text, p)]
    assert not missing, f"{name} does not say what these are: {missing}"


def _named(text: str, word: str) -> bool:
    return re.search(rf"\b{re.escape(word)}\b", text) is not None


def test_every_page_is_reachable_from_the_index():
    index = PAGES[ROOT / "docs" / "index.md"]
    for page in PAGES:
        relative = page.relative_to(ROOT / "docs").with_suffix("").as_posix()
        if relative != "index":
            assert relative in index, f"docs/index.md does not list {relative}"


def test_nothing_that_we_ship_names_one_machine():
    pattern = re.compile(r"(?<![\w.])/(work|farm|root|tmp|home)/[\w.-]")
    for folder in ("fpjax", "tuning", "benchmarks", "docs", "examples"):
        for file in (ROOT / folder).rglob("*"):
            if file.suffix in {".py", ".md", ".toml"} and "_build" not in file.parts:
                assert not pattern.search(file.read_text()), file
