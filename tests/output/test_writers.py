"""Everything that is written goes through the one writer that leaves whole files or none."""

import ast
from pathlib import Path

REPO = Path(__file__).parents[2]
WRITER = "fpjax/output/runfile.py"
STREAMS = {"file", "buffer", "body", "whole"}  # names of what `whole_file` gave, or of memory
ITS_OWN = {"fpjax/gap/report/html.py"}  # a partial file of its own, removed however it ends


def writes(path):
    """Lines of a module that write to a path themselves."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        modes = node.args[isinstance(node.func, ast.Name) :] + [each.value for each in node.keywords]
        words = [part.value for part in modes if isinstance(part, ast.Constant) and isinstance(part.value, str)]
        first = getattr(node.args[0], "id", "") if node.args else ""
        if name in ("write_text", "write_bytes") or (name == "savefig" and first not in STREAMS):
            yield node.lineno
        elif name in ("save", "savez", "savetxt", "dump") and first not in STREAMS:
            if isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") in ("np", "json"):
                yield node.lineno
        elif name == "open" and any(set(word) & set("wxa") and set(word) <= set("rwxab+t") for word in words):
            where = node.args[0] if node.args else None
            # an archive within a stream, and the place where output goes that nobody reads any more
            if ast.unparse(node.func) not in ("archive.open",) and ast.unparse(where) != "os.devnull":
                yield node.lineno


def test_no_module_writes_a_file_by_itself():
    found = [
        f"{path.relative_to(REPO)}:{line}"
        for package in ("fpjax", "tuning")
        for path in sorted((REPO / package).rglob("*.py"))
        if str(path.relative_to(REPO)) not in {WRITER, *ITS_OWN}
        for line in writes(path)
    ]
    assert not found


def test_the_scan_sees_what_writes(tmp_path):
    lines = ["path.write_text('a')", "open('a', 'wb')", "np.savez(path, a=1)", "np.savetxt(path, x)",
             "figure.savefig(path)", "path.open('xb')"]  # fmt: skip
    kept = ["open('a', 'rb')", "np.save(buffer, x)", "figure.savefig(file)", "path.open()", "open(os.devnull, 'w')"]
    for line, count in [*((line, 1) for line in lines), *((line, 0) for line in kept)]:
        (tmp_path / "a.py").write_text(line)
        assert len(list(writes(tmp_path / "a.py"))) == count, line
