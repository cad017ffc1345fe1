"""The report's pictures zoom, in a real browser; skipped where none is installed."""

import json
import re
import shutil
import subprocess

import pytest
from report_cases import CASES

from fpjax.gap.report import write_report

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(browser is None, reason="no Chromium or Chrome is installed")

# Every way to zoom, on the first picture; each leaves what the picture then shows.
ACT = """<script>
const out = {}, svg = document.querySelector("figure .wide svg"), box = svg.parentElement;
const place = svg.getBoundingClientRect();
const at = (x, y, more) => ({ clientX: place.left + x * place.width, clientY: place.top + y * place.height,
  bubbles: true, cancelable: true, pointerId: 1, pointerType: "mouse", button: 0, ...more });
const pointer = (kind, x, y, more) => svg.dispatchEvent(new PointerEvent("pointer" + kind, at(x, y, more)));
const key = name => svg.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true, cancelable: true }));
const wheel = more => svg.dispatchEvent(new WheelEvent("wheel", { deltaY: -100, ...at(0.2, 0.3), ...more }));
const note = name => { out[name] = svg.getAttribute("viewBox").split(" ").map(Number); };
svg.setPointerCapture = () => {};
note("whole");
wheel({}); note("wheel over a picture that nobody clicked");
key("+"); note("plus"); key("ArrowRight"); note("right"); key("0"); note("zero");
wheel({ ctrlKey: true }); note("wheel"); svg.dispatchEvent(new MouseEvent("dblclick")); note("double click");
pointer("down", 0.2, 0.2); pointer("move", 0.3, 0.3); out.read = box.querySelector("output").textContent;
pointer("up", 0.3, 0.3); note("rectangle");
pointer("down", 0.5, 0.5, { shiftKey: true }); pointer("move", 0.4, 0.5, { shiftKey: true }); note("pan");
pointer("up", 0.4, 0.5); box.querySelectorAll("button")[2].click(); note("reset");
for (const [id, x] of [[2, 0.3], [3, 0.6]]) pointer("down", x, 0.5, { pointerType: "touch", pointerId: id });
for (const x of [0.7, 0.8]) pointer("move", x, 0.5, { pointerType: "touch", pointerId: 3 });
note("pinch");
out.buttons = [...box.querySelectorAll("button")].map(each => each.getAttribute("aria-label"));
document.title = "RESULT" + JSON.stringify(out);
</script></body>"""


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("zoom")
    source = write_report(CASES["explained"](), folder).read_text(encoding="utf-8")
    # The page itself would refuse this script.
    source = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", source).replace("</body>", ACT)
    (folder / "acted.html").write_text(source, encoding="utf-8")
    words = ["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1200,900", "--dump-dom"]
    page = subprocess.run(
        [str(browser), *words, (folder / "acted.html").as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    found = re.search(r"<title>RESULT(.*?)</title>", page)
    assert found, page[:2000]
    return json.loads(found.group(1).replace("&lt;", "<").replace("&amp;", "&"))


@pytest.mark.long  # starts a browser
def test_every_way_zooms_and_comes_back(shown):
    whole = pytest.approx(shown["whole"], rel=1e-5)
    for name in ("wheel over a picture that nobody clicked", "zero", "double click", "reset"):
        assert shown[name] == whole, name
    _, _, width, height = shown["whole"]
    for name in ("plus", "right", "wheel", "rectangle", "pan", "pinch"):
        x, y, w, h = shown[name]
        assert w < 0.9 * width, name
        assert h / w == pytest.approx(height / width), name
        assert -1e-3 <= x <= width - w + 1e-3, name
        assert -1e-3 <= y <= height - h + 1e-3, name


def test_a_rectangle_becomes_the_view_and_arrows_and_a_drag_move_it(shown):
    _, _, width, height = shown["whole"]
    x, y, w, _ = shown["rectangle"]
    assert (x, y, w) == pytest.approx((0.2 * width, 0.2 * height, 0.1 * width), abs=0.01 * width)
    assert shown["right"][0] > shown["plus"][0]
    assert shown["pan"][0] > shown["rectangle"][0]


def test_values_are_read_under_the_pointer_and_buttons_have_names(shown):
    assert re.fullmatch(r"time \[s\]: [-\d.e]+, torque \[N·m\]: [-\d.e]+", shown["read"])
    assert shown["buttons"] == ["Zoom in", "Zoom out", "Show the whole picture"]
