"""A page of the documentation from the results: every case with its verdict, its checks and one picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fpjax.output.json_object import JsonObject
from fpjax.output.runfile import write_whole

from .gallery import gap_words

WIDTH = 1000  # of a picture on the page [pixels]
COLOURS = 64  # of its palette, enough for lines on white


def write_page(page: Path, out: Path, results: Sequence[JsonObject], versions: dict[str, str]) -> None:
    """Write a MyST page, and beside it a folder of its pictures.

    Args:
        page: the file; its pictures go into a folder of its name beside it.
        out: the folder of the cases, as `run_real` leaves it.
        results: what results.json holds.
        versions: of the packages that made the diagnoses, by name.
    """
    page.parent.mkdir(parents=True, exist_ok=True)
    folder = page.with_suffix("")
    for old in folder.glob("*.png"):
        old.unlink()
    right, sure = sum(one["right"] for one in results), sum(one["wrongly_sure"] for one in results)
    made = ", ".join(f"{name} {version}" for name, version in versions.items()) or "versions unknown"
    lines = [
        "# Gallery: records of real machines",
        "",
        "Written by the command below, with every figure as it printed it; the records are public and are not part of",
        "the repository. What is documented of each, and how a diagnosis is checked against it, is described in",
        "[evidence](evidence.md).",
        "",
        "```console",
        "$ python -m benchmarks real --out DIR --page docs/gallery.md",
        "```",
        "",
        f"{right} of {len(results)} as documented, {sure} wrongly sure ({made}).",
        "",
        "| case | verdict | causes | missing torque, withheld | as documented |",
        "|---|---|---|---|---|",
    ]
    for one in results:
        mark = "yes" if one["right"] else "**no**"
        name, gap = f"[{one['case']}](#{one['case']})", gap_words(one["gap"], one["causes"])
        cells = (name, _words(one["verdict"]), _causes(one), gap, mark)
        lines.append(f"| {' | '.join(cells)} |")
    for one in results:
        lines += ["", *_section(one, out, folder, page)]
    write_whole(page, "\n".join(lines) + "\n")


def _section(one: JsonObject, out: Path, folder: Path, page: Path) -> list[str]:
    lines = [
        f"## {one['case']}",
        "",
        f"{one['question'][:1].upper()}{one['question'][1:].rstrip('.')}{'' if one['question'].endswith('?') else '.'} "
        f"*{one['records']}; {one['source']}.*",
        "",
    ]
    if one["error"]:
        return [*lines, f"The diagnosis failed: {one['error']}"]
    lines += [f"**{_words(one['verdict'])}**: {_causes(one)}.", ""]
    lines += ["| first in the ranking | probability | parameters (90 % interval) |", "|---|---|---|"]
    for entry in one["ranking"]:
        found = "; ".join(_parameter(name, value) for name, value in (entry["parameters"] or {}).items())
        lines.append(f"| {_words(entry['effect'])} | {100 * entry['probability']:.1f} % | {found} |")
    lines += ["", "| documented | holds | found |", "|---|---|---|"]
    for check in one["checks"]:
        holds = {True: "yes", False: "**no**", None: "not asked"}[check["passed"]]
        lines.append(f"| {check['sentence']} | {holds} | {check['found']} |")
    picture = out / one["case"] / "overview.png"
    if picture.exists():
        small = _shrink(picture, folder / f"{one['case']}.png")
        place = small.relative_to(page.parent).as_posix()
        lines += ["", f"![{one['case']}: verdict, measured against simulated, where, and how far]({place})"]
    return lines


def _parameter(name: str, value: JsonObject) -> str:
    unit = "" if value["unit"] == "1" else f" {value['unit']}"
    if value.get("low") is None or value.get("high") is None:
        return f"{_words(name)} {value['value']:.4g}{unit}"
    return f"{_words(name)} {value['value']:.4g}{unit} ({value['low']:.4g} to {value['high']:.4g})"


def _causes(one: JsonObject) -> str:
    return ", ".join(_words(name) for name in one["causes"]) or "no cause asserted"


def _words(name: Any) -> str:
    return str(name).replace("_", " ")


def _shrink(source: Path, target: Path) -> Path:
    """The picture at a page's width with a small palette: a tenth of its bytes."""
    from PIL import Image  # comes with matplotlib

    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(source) as picture:
        height = round(picture.height * WIDTH / picture.width)
        small = picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        small.quantize(COLOURS).save(target, optimize=True)
    return target
