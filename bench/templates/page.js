"use strict";
// Figures that answer: what they show stands in attributes data-.. of their parts (motion/marks.py).
(() => {
  const all = (query, root = document) => [...root.querySelectorAll(query)];
  const json = (part, name) => JSON.parse(part.dataset[name] ?? "null");
  const make = (tag, parent, attributes = {}) => {
    const one = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
    return parent.appendChild(one);
  };
  const short = (value, span) => {
    const digits = Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(Math.abs(span) || 1))));
    return value.toFixed(digits).replace(/^-(?=[0.]*$)/, "");
  };
  document.body.classList.add("live");
  const told = document.body.appendChild(document.createElement("div"));
  told.id = "told";
  told.setAttribute("role", "status");

  // Names: whoever points at a system sees it in all figures and tables; a click keeps it.
  const marked = all("[data-of]");
  const figures = new Map();
  for (const part of marked) {
    part.names = json(part, "of");
    const svg = part.closest("svg");
    if (svg) figures.set(svg, [...(figures.get(svg) ?? []), part]);
  }
  let kept = null;
  const show = (names) => {
    const within = (part) => part.names.some((name) => names.includes(name));
    for (const parts of figures.values()) {
      const there = names !== null && parts.some(within);
      for (const part of parts) part.classList.toggle("faint", there && !within(part) && !part.dataset.always);
    }
    for (const row of all("tr[data-of]")) row.classList.toggle("lit", names !== null && within(row));
  };
  const keep = (names) => {
    kept = String(kept) === String(names) ? null : names;
    show(kept);
    for (const part of all("[aria-pressed]")) part.setAttribute("aria-pressed", String(kept) === String(part.names));
  };
  const tell = (text, x, y) => {
    told.textContent = text;
    told.style.left = `${Math.max(4, Math.min(x + 14, innerWidth - told.offsetWidth - 8))}px`;
    told.style.top = `${y + 22 + told.offsetHeight > innerHeight ? y - told.offsetHeight - 10 : y + 16}px`;
  };
  const choose = (part) => {
    part.tabIndex = 0;
    part.setAttribute("role", "button");
    part.setAttribute("aria-pressed", "false");
    part.setAttribute("aria-label", `show ${part.names.join(", ")} in all figures`);
    part.addEventListener("click", (event) => { event.stopPropagation(); keep(part.names); });
    part.addEventListener("focus", () => show(part.names));
    part.addEventListener("blur", () => show(kept));
    part.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") { event.preventDefault(); keep(part.names); }
    });
  };
  for (const row of all("tr[data-of]")) {
    const name = row.cells[0];
    name.names = row.names;
    choose(name);
    row.addEventListener("pointerenter", () => show(row.names));
    row.addEventListener("pointerleave", () => show(kept));
  }
  all("g[data-entry]").filter((entry) => entry.querySelector("text")).forEach(choose);
  addEventListener("keydown", (event) => { if (event.key === "Escape") { kept = null; show(null); tell("", 0, 0); } });

  // Tables: a column's header sorts by it, numbers before dashes.
  const value = (cell) => {
    const text = cell.dataset.value ?? cell.firstChild?.textContent ?? "";
    const number = parseFloat(text.replace(/,/g, ""));
    return Number.isNaN(number) ? (/^[–\s]*$/.test(text) ? null : text) : number;
  };
  for (const table of all("table")) {
    const head = table.tHead?.rows[table.tHead.rows.length - 1];
    for (const cell of head?.cells ?? []) {
      const button = document.createElement("button");
      button.append(...cell.childNodes);
      cell.append(button);
      button.addEventListener("click", () => {
        const down = cell.getAttribute("aria-sort") === "ascending";
        for (const other of head.cells) other.removeAttribute("aria-sort");
        cell.setAttribute("aria-sort", down ? "descending" : "ascending");
        const keys = new Map([...table.tBodies[0].rows].map((row) => [row, value(row.cells[cell.cellIndex])]));
        const order = ([, a], [, b]) =>
          a === null || b === null ? (a === null) - (b === null)
            : (typeof a === typeof b && typeof a === "number" ? a - b : String(a).localeCompare(String(b))) * (down ? -1 : 1);
        table.tBodies[0].append(...[...keys].sort(order).map(([row]) => row));
      });
    }
  }

  // Axes: where they stand, what they span, and the part of it that is looked at.
  class Axes {
    constructor(group) {
      this.group = group;
      this.svg = group.closest("svg");
      [this.left, this.top, this.right, this.bottom] = json(group, "box");
      this.log = { x: group.dataset.xscale === "log", y: group.dataset.yscale === "log" };
      this.whole = { x: this.ends("x"), y: this.ends("y") };
      this.span = { ...this.whole };
      this.lines = all("[data-line]", group).map((part) => {
        const path = part.querySelector("path");
        return { part, points: (path?.getAttribute("d").match(/-?[\d.]+ -?[\d.]+/g) ?? []).map((pair) => pair.split(" ").map(Number)) };
      });
    }
    ends(axis) {
      const ends = json(this.group, axis);
      return ends && (this.log[axis] ? ends.map(Math.log10) : ends);
    }
    value(axis, at, span = this.span[axis]) { // of a place on the page
      const share = axis === "x" ? (at - this.left) / (this.right - this.left) : (this.bottom - at) / (this.bottom - this.top);
      const found = span[0] + share * (span[1] - span[0]);
      return this.log[axis] ? 10 ** found : found;
    }
    moved(axis, at) { // where a place of the whole is in what is looked at
      const [low, high] = this.span[axis] ?? [0, 1], [a, b] = this.whole[axis] ?? [0, 1];
      const origin = axis === "x" ? this.left : this.bottom, length = axis === "x" ? this.right - this.left : this.top - this.bottom;
      const whole = a + ((at - origin) / length) * (b - a);
      return origin + ((whole - low) / (high - low)) * length;
    }
    inside([x, y]) { return x >= this.left && x <= this.right && y >= this.top && y <= this.bottom; }
    nearest([x, y]) { // the point of a line next to a place, within 9 units
      let best = null, least = 81;
      for (const { part, points } of this.lines)
        for (const point of points) {
          const far = (this.moved("x", point[0]) - x) ** 2 + (this.moved("y", point[1]) - y) ** 2;
          if (far < least) [best, least] = [{ part, point }, far];
        }
      return best;
    }
    told({ part, point }) {
      const of = (axis, at) => {
        const [low, high] = this.whole[axis], found = this.value(axis, at, this.whole[axis]);
        const span = this.log[axis] ? found : (high - low) / 10;
        return `${this.group.dataset[`${axis}label`] || axis}: ${short(found, span)}`;
      };
      return [part.names.join(", "), ...["x", "y"].filter((axis) => this.whole[axis]).map((axis) => of(axis, point[axis === "x" ? 0 : 1]))].join("\n");
    }
    look(spans) { // draw a part of the whole
      this.span = { ...this.whole, ...spans };
      const differs = (axis) => String(this.span[axis]) !== String(this.whole[axis]), zoomed = differs("x") || differs("y");
      this.group.classList.toggle("zoomed", zoomed);
      const pair = (x, y) => `${this.moved("x", +x).toFixed(2)} ${this.moved("y", +y).toFixed(2)}`;
      for (const path of all("path[clip-path]", this.group)) {
        if (path.closest(".xtick, .ytick")) continue;
        path.whole ??= path.getAttribute("d");
        path.setAttribute("d", zoomed ? path.whole.replace(/(-?[\d.]+) (-?[\d.]+)/g, (_, x, y) => pair(x, y)) : path.whole);
      }
      for (const use of all("g[clip-path] > use", this.group)) {
        use.whole ??= [use.getAttribute("x"), use.getAttribute("y")];
        const [x, y] = pair(...use.whole).split(" ");
        use.setAttribute("x", x);
        use.setAttribute("y", y);
      }
      for (const axis of ["x", "y"])
        for (const tick of all(`.${axis}tick`, this.group)) {
          const text = tick.querySelector("text"), at = +(tick.querySelector("use")?.getAttribute(axis) ?? NaN);
          if (!text || !this.whole[axis] || Number.isNaN(at)) continue;
          text.whole ??= text.textContent;
          const span = this.log[axis] ? this.value(axis, at) : this.span[axis][1] - this.span[axis][0];
          text.textContent = differs(axis) ? short(this.value(axis, at), span) : text.whole;
        }
    }
    zoom(axis, share, factor) { // keeps what is at a share of the axis in place
      const [low, high] = this.span[axis], [a, b] = this.whole[axis], at = low + share * (high - low);
      const ends = [at - (at - low) * factor, at + (high - at) * factor];
      return Math.abs(ends[1] - ends[0]) >= Math.abs(b - a) ? [a, b] : ends;
    }
  }
  const axes = all("g[data-box]").map((group) => new Axes(group));

  // Time: who points at one sees it in all figures of the course.
  const point = (from, time) => {
    for (const one of axes.filter((other) => other.group.dataset.cursor === from)) {
      const seconds = json(one.group, "seconds") ?? 1, ends = one.whole.x;
      if (!one.group.dataset.still) {
        one.cursor ??= make("line", one.group, { class: "cursor", y1: one.top, y2: one.bottom });
        const x = one.left + ((time / seconds - one.span.x[0]) / (one.span.x[1] - one.span.x[0])) * (one.right - one.left);
        one.cursor.setAttribute("visibility", time !== null && x >= one.left && x <= one.right && ends ? "visible" : "hidden");
        one.cursor.setAttribute("x1", x);
        one.cursor.setAttribute("x2", x);
        continue;
      }
      for (const line of one.lines.filter(({ part }) => part.dataset.step)) {
        line.dot ??= make("circle", one.group, { class: "dot", r: 3, fill: getComputedStyle(line.part.querySelector("path")).stroke });
        const at = line.points[Math.round(time / json(line.part, "step"))];
        line.dot.setAttribute("visibility", time !== null && at ? "visible" : "hidden");
        if (at) { line.dot.setAttribute("cx", one.moved("x", at[0])); line.dot.setAttribute("cy", one.moved("y", at[1])); }
      }
    }
  };

  // The pointer and the keys, figure by figure.
  for (const svg of new Set([...figures.keys(), ...axes.map((one) => one.svg)])) {
    const own = axes.filter((one) => one.svg === svg), zooming = own.filter((one) => one.group.dataset.zoom);
    const stops = (figures.get(svg) ?? []).filter((part) => part.dataset.say || part.dataset.line);
    const timed = own.find((one) => one.group.dataset.cursor)?.group.dataset.cursor;
    const place = (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      return [at.x, at.y];
    };
    const reset = document.createElement("button");
    Object.assign(reset, { className: "reset", textContent: "whole", hidden: true, type: "button" });
    svg.parentNode.insertBefore(reset, svg.nextSibling);
    const look = (one, spans) => {
      const together = one.group.dataset.zoom === "x" ? zooming.filter((other) => other.group.dataset.zoom === "x") : [one];
      for (const other of together) other.look(spans);
      reset.hidden = !zooming.some((other) => other.group.classList.contains("zoomed"));
    };
    const whole = () => { for (const one of zooming) look(one, {}); };
    reset.addEventListener("click", whole);
    const zoom = (one, [x, y], factor) => {
      const share = { x: (x - one.left) / (one.right - one.left), y: (one.bottom - y) / (one.bottom - one.top) };
      look(one, Object.fromEntries([...one.group.dataset.zoom].map((axis) => [axis, one.zoom(axis, share[axis], factor)])));
    };
    let from = null, frame = null;
    svg.addEventListener("pointerdown", (event) => {
      const at = place(event), one = zooming.find((other) => other.inside(at));
      if (one && event.button === 0 && !event.target.closest("[data-entry]")) { from = { one, at }; svg.setPointerCapture(event.pointerId); }
    });
    svg.addEventListener("pointermove", (event) => {
      const at = place(event), here = own.find((one) => one.inside(at));
      if (from) { // the part that is being chosen
        const { one, at: start } = from, both = one.group.dataset.zoom === "xy";
        const [x, y] = [Math.max(one.left, Math.min(one.right, at[0])), Math.max(one.top, Math.min(one.bottom, at[1]))];
        if (Math.abs(x - start[0]) < 4) return;
        frame ??= make("rect", svg, { class: "window" });
        const sides = { x: Math.min(x, start[0]), width: Math.abs(x - start[0]) };
        const heights = both ? { y: Math.min(y, start[1]), height: Math.abs(y - start[1]) } : { y: one.top, height: one.bottom - one.top };
        for (const [name, side] of Object.entries({ ...sides, ...heights })) frame.setAttribute(name, side);
        return;
      }
      const near = here?.nearest(at), part = event.target.closest?.("[data-of]") ?? near?.part;
      const said = part && (part.dataset.say !== undefined ? `${part.names.join(", ")}\n${part.dataset.say}` : near?.part === part ? here.told(near) : "");
      tell(said || "", event.clientX, event.clientY);
      show(part ? part.names : kept);
      if (here?.group.dataset.cursor && here.span.x && !here.group.dataset.still)
        point(timed, here.value("x", at[0]) * (json(here.group, "seconds") ?? 1));
    });
    svg.addEventListener("pointerup", (event) => {
      if (frame) {
        const side = (name) => +frame.getAttribute(name), { one } = from, ends = (axis, a, b) => {
          const found = [a, b].map((at) => one.value(axis, at));
          return one.log[axis] ? found.map(Math.log10) : found;
        };
        const spans = { x: ends("x", side("x"), side("x") + side("width")) };
        if (one.group.dataset.zoom === "xy" && side("height") > 4) spans.y = ends("y", side("y") + side("height"), side("y"));
        look(one, spans);
        frame.remove();
      } else if (from) {
        const part = event.target.closest?.("[data-of]") ?? from.one.nearest(from.at)?.part;
        if (part) keep(part.names);
        svg.focus({ preventScroll: true });
      }
      from = frame = null;
    });
    svg.addEventListener("pointerleave", () => { tell("", 0, 0); show(kept); if (timed) point(timed, null); });
    svg.addEventListener("dblclick", whole);
    svg.addEventListener("wheel", (event) => { // a page that scrolls by does not zoom: a click first
      const at = place(event), one = zooming.find((other) => other.inside(at));
      if (one && document.activeElement === svg) { event.preventDefault(); zoom(one, at, Math.exp(event.deltaY / 400)); }
    }, { passive: false });
    if (!stops.length && !zooming.length) continue;
    svg.tabIndex = 0;
    svg.setAttribute("role", "group");
    svg.setAttribute("aria-roledescription", `figure; arrow keys go through what it shows${zooming.length ? ", + and - zoom, 0 shows the whole" : ""}`);
    let stop = -1;
    svg.addEventListener("keydown", (event) => {
      const turn = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      const factor = { "+": 0.7, "-": 1.4 }[event.key];
      if (event.target !== svg || !(turn || factor || event.key === "0")) return;
      event.preventDefault();
      if (event.key === "0") whole();
      for (const one of factor ? zooming.slice(0, 1) : []) zoom(one, [(one.left + one.right) / 2, (one.top + one.bottom) / 2], factor);
      if (!turn || !stops.length) return;
      stop = (stop + turn + stops.length) % stops.length;
      const { x, y, width } = stops[stop].getBoundingClientRect();
      show(stops[stop].names);
      tell([stops[stop].names.join(", "), stops[stop].dataset.say].filter(Boolean).join("\n"), x + width, y);
    });
    svg.addEventListener("blur", () => { tell("", 0, 0); show(kept); });
  }
})();
