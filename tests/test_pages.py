"""Pages: they are sound and stand alone, and their script answers who points, clicks and types."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import page_html
import pandas as pd
import pytest

from bench import colours, columns, pages, plots
from bench.memory import page as memory_page
from bench.memory.measure import Memory
from bench.memory.pareto import with_fronts
from motion import figures
from motion.marks import mark

SYSTEMS = ["mm-exact", "mm-exact-quantised-16", "lmm-PSD", "lmm-D", "pfnn-cubic"]
COLOURS = colours.of(SYSTEMS)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def trace(system, speed):
    time = np.arange(120) / 60
    way = np.stack([speed * time, np.zeros(120)], axis=-1)
    return SimpleNamespace(
        system=system, course="line", fps=60.0, path=way, asked=way, walked=way, speed=np.full(120, speed),
        asked_speed=np.ones(120), skate=np.zeros(119),
        same=lambda other, poses=True: other.walked is way,
    )  # fmt: skip


@pytest.fixture(scope="module")
def text():
    """A page with a table of systems, a plot of points, one of bars, and those of a course."""
    systems = pd.DataFrame(
        {
            "system": SYSTEMS,
            "kind": ["search in all of the data", "compressed", "learned", "learned", "PFNN"],
            "about": ["<b>"] * 5,
            "memory_mb": [100.0, 25.0, 5.0, 20.0, 1000.0],
            "memory_poses_mb": [100.0, 25.0, 0.0, 0.0, 0.0],
            "memory_network_mb": [0.0, 0.0, 5.0, 20.0, 1000.0],
            "pose_cm": [0.0, 0.01, 0.3, 0.3, np.nan],
            "error": ["decoded"] * 4 + ["one step"],
            "drift_cm": [np.nan] * 5,
        }
    )
    facts = {"name": "a & b", "fingerprint": "f", "frames": 9, "fps": 60.0, "minutes": 1.0, "ranges": 1}
    facts |= {"mirrored_ranges": 0, "joints": 2, "features": 27}
    features = [{"features": "f", "columns": 1, "fps": 60.0, "bytes_a_number": 4.0, "mb_an_hour": 1.0}]
    others = [{"system": "LMM", "joints": 2, "frames": 9, "mb": 1.0, "bytes_a_frame": 2.0}]
    memory = Memory(with_fronts(systems), pd.DataFrame(features), pd.DataFrame(others), [], facts, {}, {})
    page = memory_page.html(memory, command="bench memory <a&b>")
    groups = [[trace("mm-exact", 1.0)], [trace("lmm-PSD", 0.5)]]
    drawn = []
    for name, draw in (("paths", plots.paths), ("time", plots.over_time)):
        with figures.style(name):
            drawn.append(figures.svg(draw(groups, COLOURS), name))
    return page.replace("<script>", "".join(f"<figure>{svg}</figure>" for svg in drawn) + "<script>")


def test_a_page_is_sound_and_stands_alone(text):
    page = page_html.check(text)
    names = {name for _, of in page.marked for name in of}
    assert set(SYSTEMS) <= names and {"poses", "network", "commanded path"} <= names
    assert [of for tag, of in page.marked if tag == "tr"][: len(SYSTEMS)] == [[name] for name in SYSTEMS]
    assert "bench memory &lt;a&amp;b&gt;" in text and 'title="&lt;b&gt;"' in text


def test_the_script_asks_for_what_figures_say(text):
    said = set(re.findall(r"\bdata-([a-z]+)=", text)) | {"value"}
    script = text[text.index("<script>") :]
    asked = set(re.findall(r"dataset\.(\w+)", script)) | set(re.findall(r'json\([\w.]+, "(\w+)"\)', script))
    assert {"of", "box", "line", "step", "cursor"} <= asked <= said | {"seconds"}


def test_axes_say_where_they_stand_and_lines_keep_their_points(text):
    x = np.linspace(0, 10, 50)
    with figures.style("axes"):
        picture, (axes,) = figures.figure(4, 3)
        (line,) = axes.plot(x, np.zeros(50), label="flat & straight")
        mark(line, "flat", step=0.5)
        mark(axes, zoom="x")
        axes.set_xlim(0, 10)
        body = figures.svg(picture, "a <figure>")
    assert 'aria-label="a &lt;figure&gt;"' in body
    (found,) = re.findall(r'<g ([^>]*data-axes="0"[^>]*)>', body)
    facts = dict(re.findall(r'data-(\w+)="([^"]*)"', found))
    assert json.loads(facts["x"]) == [0, 10] and facts["zoom"] == "x" and facts["xscale"] == "linear"
    left, top, right, bottom = json.loads(facts["box"])
    assert 0 < left < right <= 4 * 72 and 0 < top < bottom <= 3 * 72
    (drawn,) = re.findall(
        r'<g data-of="\[&quot;flat&quot;\]"[^>]*data-line="true"[^>]*>\s*<path d="([^"]*)"', body
    )
    points = np.array([pair.split() for pair in re.findall(r"[\d.]+ [\d.]+", drawn)], float)
    np.testing.assert_allclose(points[:, 0], left + x / 10 * (right - left), atol=0.02)
    assert not re.search(r'\bid="(figure|axes|patch|line2d|text)_', body)


def test_lines_of_one_style_become_one_element():
    with figures.style("joined"):
        picture, (axes,) = figures.figure(4, 3)
        axes.vlines([1, 2, 3, 4], 0, 1, color=["red", "red", "blue", "blue"])
        body = figures.svg(picture)
    strokes = re.findall(r'<path d="([^"]*)"[^>]*stroke: #(ff0000|0000ff)', body)
    assert [(colour, way.count("M")) for way, colour in strokes] == [("ff0000", 2), ("0000ff", 2)]


def test_systems_have_a_colour_each_and_families_a_hue():
    names = (*SYSTEMS, "mm-faiss-pq-free", "mann-4", "lmm-walk-D", "own")
    kinds = ("mm", "small", "lmm", "lmm", "pfnn", "mm", "mann", "lmm", "other")
    assert tuple(map(colours.family, names)) == kinds
    assert len(set(COLOURS.values())) == len(SYSTEMS)
    assert colours.of(["lmm-PSD", "lmm-D", "lmm-PSD"]) == {
        name: COLOURS[name] for name in ("lmm-PSD", "lmm-D")
    }


# How light is seen without one kind of cones (Machado and others, IEEE TVCG 15, 2009, severity 1).
EYES = {
    "all": np.eye(3),
    "no red": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "no green": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "no blue": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def light(colour):
    """Linear red, green and blue [3] of a colour as pages write it."""
    parts = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIE L*a*b* of linear light [3], white D65."""
    matrix = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(matrix @ np.clip(rgb, 1e-9, 1) / [0.9505, 1, 1.089])
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("eyes", EYES)
def test_systems_are_told_apart_by_whatever_eyes(eyes):
    names = ["mm-exact", "mm-exact-float16", "mm-coded-quantised-11", "lmm-PSD", "lmm-D", "pfnn-cubic"]
    names += ["pfnn-constant", "mann-4"]
    seen = [lab(np.array(EYES[eyes]) @ light(colour)) for colour in colours.of(names).values()]
    apart = [np.linalg.norm(a - b) for i, a in enumerate(seen) for b in seen[:i]]
    assert min(apart) > 12  # 2.3 is just noticed
    assert len({colours.mark(name) for name in names}) == 5


def test_colours_are_seen_on_white_and_on_black():
    for colour in colours.of(SYSTEMS).values():
        bright = light(colour) @ [0.2126, 0.7152, 0.0722]
        assert 1.05 / (bright + 0.05) > 1.8 and (bright + 0.05) / (0.0095 + 0.05) > 1.8


def test_round_numbers_stand_along_logarithmic_axes():
    for low, high, expected in ((60, 250, [100, 200]), (1, 4096, [1, 10, 100, 1000]), (30, 50, [30, 40, 50])):
        picture, (axes,) = figures.figure(4, 3)
        axes.plot([low, high], [1, 2])
        plots.logarithmic(axes, "x")
        picture.draw_without_rendering()
        shown = [t.get_text() for t in axes.get_xticklabels() if low <= t.get_position()[0] <= high]
        assert {f"{number:g}" for number in expected} <= set(shown) and len(shown) <= 8


@pytest.mark.parametrize(
    ("value", "digits", "expected"), [(1234.5, 1, "1,234.5"), (None, 1, "–"), (np.nan, 0, "–")]
)
def test_numbers(value, digits, expected):
    assert pages.number(value, digits) == expected


def test_worth_is_shown_of_what_is_known_and_names_whom_none_cheaper_beats():
    rows = pd.DataFrame({"system": SYSTEMS[:3], "frame_mean_us": [50.0, 60.0, 200.0]})
    assert plots.worth(rows, COLOURS) is None
    rows["skate_cm_s"], rows["path_cm"] = [9.0, 9.5, 5.0], np.nan
    (axes,) = plots.worth(rows, COLOURS).axes
    names = {text.get_text(): text.get_fontweight() for text in axes.texts}
    assert names == {"mm-exact": "bold", "lmm-PSD": "bold", "mm-exact-quantised-16": "normal"}
    assert axes.get_ylabel() == "foot skate, cm/s"


def test_crowds_are_a_line_a_system():
    rows = pd.DataFrame(
        {"system": ["mm-exact", "mm-exact", "lmm-PSD"], "characters": [1, 16, 16], "us": [9.0, 4.0, 3.0]}
    )
    (axes,) = plots.crowd(rows, COLOURS).axes
    lines = {line.get_label(): (list(line.get_xdata()), line.get_color()) for line in axes.lines}
    assert lines == {"mm-exact": ([1, 16], COLOURS["mm-exact"]), "lmm-PSD": ([16], COLOURS["lmm-PSD"])}


def test_the_best_of_a_column_are_those_shown_alike_unless_many_are():
    least, one = columns.Column("x", "x", "cm", 1, ""), columns.Column("x", "x", "", 2, "", "near one")
    assert list(least.best(pd.Series([1.02, 1.04, 2.0, np.nan, 3.0]))) == [True, True, False, False, False]
    assert not least.best(pd.Series([1.0, 1.0, 2.0])).any()
    assert list(one.best(pd.Series([0.5, 1.1, 1.3]))) == [False, True, False]


ACTIONS = """
const out = {};
const all = (query, root = document) => [...root.querySelectorAll(query)];
const parts = (name) => all("svg [data-of]").filter((part) => part.names.includes(name));
const faint = (name) => parts(name).filter((part) => part.classList.contains("faint")).length;
const table = all("table").find((one) => one.querySelector("tr[data-of]"));
const order = () => [...table.tBodies[0].rows].map((row) => row.dataset.of);
const key = (at, name) => at.dispatchEvent(new KeyboardEvent("keydown", { key: name, bubbles: true }));
const entry = all("g[data-entry]").find((one) => one.textContent.trim() === "mm-exact");
entry.dispatchEvent(new MouseEvent("click", { bubbles: true }));
out.clicked = [faint("mm-exact"), faint("lmm-PSD") > 0, entry.getAttribute("aria-pressed")];
out.lit = all("tr.lit", table).map((row) => row.dataset.of);
key(document.body, "Escape");
out.released = document.querySelectorAll(".faint, .lit").length;
const column = [...table.tHead.rows[0].cells].findIndex((cell) => cell.textContent.startsWith("loaded MB"));
const head = table.tHead.rows[0].cells[column];
head.querySelector("button").click();
out.rising = [order(), head.getAttribute("aria-sort")];
head.querySelector("button").click();
out.falling = order();
table.tHead.rows[0].cells[column + 1].querySelector("button").click();
out.unknown_last = order().at(-1);
const svg = document.querySelector("svg[aria-label=time]"), axes = svg.querySelector("[data-cursor]");
const line = axes.querySelector("[data-line] path"), before = line.getAttribute("d");
const ticks = () => all(".xtick, .ytick", svg).map((tick) => tick.textContent.trim()).join();
const labels = ticks();
svg.focus();
key(svg, "+");
out.zoomed = [line.getAttribute("d") !== before, ticks() !== labels, !svg.nextSibling.hidden];
key(svg, "0");
out.whole = [line.getAttribute("d") === before, ticks() === labels, svg.nextSibling.hidden];
const box = JSON.parse(axes.dataset.box), matrix = svg.getScreenCTM();
const at = new DOMPoint((box[0] + box[2]) / 2, box[1] + 3).matrixTransform(matrix);
svg.scrollIntoView();
svg.dispatchEvent(new PointerEvent("pointermove", { clientX: at.x, clientY: at.y, bubbles: true }));
out.cursor = all("line.cursor").map((one) => one.getAttribute("visibility"));
out.dots = all("svg[aria-label=paths] circle.dot").map((dot) => +dot.getAttribute("cx"));
const ways = all("svg[aria-label=paths] [data-step] path");
out.starts = ways.map((way) => +way.getAttribute("d").match(/[\\d.]+/)[0]);
const points = document.querySelector("svg [data-say]").closest("svg");
points.focus();
key(points, "ArrowRight");
out.told = document.getElementById("told").textContent;
const found = document.body.appendChild(document.createElement("pre"));
found.id = "found";
found.textContent = JSON.stringify(out);
"""


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium to run the page's script in")
def test_the_script_answers(text, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(text.replace("</body>", f"<script>{ACTIONS}</script></body>"))
    command = [
        CHROMIUM,
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={tmp_path / 'user'}",
    ]
    command += ["--window-size=1300,9000", "--virtual-time-budget=4000", "--dump-dom", path.as_uri()]
    dom = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
    found = json.loads(html.unescape(re.findall(r'<pre id="found">(.*?)</pre>', dom)[0]))
    assert found["clicked"] == [0, True, "true"] and found["lit"] == ['["mm-exact"]']
    assert found["released"] == 0
    by_memory = ["lmm-PSD", "lmm-D", "mm-exact-quantised-16", "mm-exact", "pfnn-cubic"]
    assert found["rising"] == [[json.dumps([name]) for name in by_memory], "ascending"]
    assert found["falling"] == found["rising"][0][::-1]
    assert found["unknown_last"] == '["pfnn-cubic"]'
    assert found["zoomed"] == [True, True, True] and found["whole"] == [True, True, True]
    assert found["cursor"] == ["visible", "visible"]  # of speed and of skate
    one, half = np.subtract(found["starts"], found["dots"])  # who walks twice as fast is twice as far by then
    assert one > 5 and one == pytest.approx(2 * half, abs=0.1)
    assert "MB" in found["told"] and "cm" in found["told"]
