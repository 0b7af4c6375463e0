// Adds to a page that is whole without it: values under the pointer, enlarging and moving of plots, one station or line picked
// out in all figures and tables, before or after alone, and vectors that turn. Values come from the drawing itself: each panel
// says how pixels and values belong together, so that nothing stands in the page twice. No network, no storage, no clock.
"use strict";
(() => {
  const NS = document.querySelector("svg")?.namespaceURI;
  const all = (query, root = document) => [...root.querySelectorAll(query)];
  const make = (name, attributes = {}, text = "") => {
    const svg = ["g", "path", "text", "clipPath", "rect"].includes(name);
    const node = svg ? document.createElementNS(NS, name) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
    if (text) node.textContent = text;
    return node;
  };
  const button = (text, label, act) => {
    const node = make("button", { type: "button", "aria-label": label, title: label }, text);
    node.addEventListener("click", act);
    return node;
  };
  // A shape that belongs to several, such as to a station and to a line of it, has a tab between their names.
  const namesOf = (node) => (node.dataset.n || "").split("\t").filter(Boolean);
  const minus = (text) => text.replace("-", "−");
  const fixed = (value, decimals) => minus(value.toFixed(Math.max(0, Math.min(9, decimals))));

  // Many names are those of a mean over many: the first say where, and a count how many more.
  const called = (name) => {
    const each = name.split("\t");
    return each.length > 4 ? `${each.slice(0, 3).join(", ")} and ${each.length - 3} more` : each.join(", ");
  };

  // What is under the pointer, beside it.
  const tip = make("div", { class: "tip", hidden: "" });
  document.body.append(tip);
  const say = (event, lines) => {
    tip.replaceChildren(...lines.map((line) => make("div", {}, line)));
    tip.hidden = false;
    const { width, height } = tip.getBoundingClientRect();
    tip.style.left = `${Math.max(4, Math.min(event.clientX + 14, innerWidth - width - 4))}px`;
    tip.style.top = `${Math.max(4, event.clientY - height - 12)}px`;
  };
  const hush = () => { tip.hidden = true; };
  // What a shape says of itself is said at once: a browser waits for a second, and says nothing to a finger.
  all("figure > svg * > title").forEach((title) => {
    const shape = title.parentElement;
    shape.dataset.told = title.textContent;
    shape.setAttribute("aria-label", title.textContent);
    title.remove();
  });
  const told = ({ target }) => {
    const shape = target.closest?.("[data-told],[data-n]");
    const line = shape?.dataset.told || (shape && called(shape.dataset.n));
    return line && [line];
  };
  const inside = (svg, event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());

  // One axis of a panel: value and pixel, and what is left of it when enlarged (pixel' = by * pixel + add).
  const axis = (text, name) => {
    const [kind, ...rest] = text.split(" ");
    const [low, high, from, to, wanted] = rest.map(Number);
    const log = kind === "log";
    const span = log ? Math.log10(high / low) : high - low;
    const value = (pixel) => {
      const share = (pixel - from) / (to - from);
      return log ? low * 10 ** (share * span) : low + share * span;
    };
    const pixel = (v) => from + (to - from) * (log ? Math.log10(v / low) : v - low) / span;
    const [label, unit = ""] = name.split(" / ");
    const self = { by: 1, add: 0, from, to, log, wanted, label, unit, value, pixel };
    self.map = (p) => self.by * p + self.add;
    self.back = (p) => (p - self.add) / self.by;
    // Pixels are written with two decimals: no more digits than they carry.
    self.text = (p) => {
      const step = Math.abs(value(p + 0.01) - value(p));
      return `${label}${label ? " " : ""}${fixed(value(p), Math.floor(-Math.log10(step)))}${unit ? ` ${unit}` : ""}`;
    };
    return self;
  };
  const ticks = (a) => {
    const [low, high] = [a.value(a.back(a.from)), a.value(a.back(a.to))].sort((x, y) => x - y);
    const rough = (high - low) / Math.max(1, a.wanted || 5);
    const decade = 10 ** Math.floor(Math.log10(rough));
    const step = ([1, 2, 5].find((f) => f * decade >= rough * 0.999) || 10) * decade;
    const marks = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step && marks.length < 64; k += 1) {
      marks.push([k * step, fixed(k * step, -Math.floor(Math.log10(step)))]);
    }
    return marks;
  };

  const PAIR = /([ML])(-?[\d.]+) (-?[\d.]+)/g;
  const shape = (node) => {
    const get = (key) => Number(node.getAttribute(key));
    const names = { path: ["d"], rect: ["x", "y", "width", "height"], circle: ["cx", "cy"], text: ["x", "y"] }[node.tagName];
    const first = names.map((name) => node.getAttribute(name));
    const numbers = names.map(get);
    const points = [];
    if (node.tagName === "path" && /\b(ln|mark|dot|dash)\b/.test(node.getAttribute("class"))) {
      const values = (node.dataset.v || "").split(" ");
      const beside = Number(node.dataset.s || 0);
      for (const [, , x, y] of first[0].matchAll(PAIR)) {
        points.push({ x: Number(x), y: Number(y), beside, name: node.dataset.n || "", value: values[points.length] || "" });
      }
    }
    const put = (ax, ay) => {
      if (ax.by === 1 && ay.by === 1 && ax.add === 0 && ay.add === 0) {
        names.forEach((name, k) => node.setAttribute(name, first[k]));
        return;
      }
      if (node.tagName === "path") {
        const moved = (_, c, x, y) => `${c}${ax.map(Number(x)).toFixed(2)} ${ay.map(Number(y)).toFixed(2)}`;
        node.setAttribute("d", first[0].replace(PAIR, moved));
        return;
      }
      const factors = [ax.map(numbers[0]), ay.map(numbers[1]), ax.by * numbers[2], ay.by * numbers[3]];
      names.forEach((name, k) => node.setAttribute(name, factors[k]));
    };
    return { node, points, put, band: node.tagName === "path" && first[0].endsWith("Z") ? first[0] : "" };
  };
  let clips = 0;
  const panel = (group) => {
    const [left, top, width, height] = group.dataset.a.split(" ").map(Number);
    const ax = axis(group.dataset.x, group.dataset.xn);
    const ay = axis(group.dataset.y, group.dataset.yn);
    const data = group.querySelector(".pts");
    const shapes = all("path,rect,circle,text", data).map(shape);
    const points = shapes.flatMap((one) => one.points);
    const bands = shapes.filter((one) => one.band);
    const places = ["tx", "ty"].map((name) => group.querySelector(`:scope > .${name}`));
    const drawn = places.map((place) => place && place.innerHTML);
    const id = `clip${clips += 1}`;
    const clip = make("clipPath", { id });
    clip.append(make("rect", { x: left, y: top, width, height }));
    group.prepend(clip);
    const marks = (place, a, vertical) => {
      place.replaceChildren();
      for (const [value, text] of ticks(a)) {
        const at = a.map(a.pixel(value));
        const d = vertical ? `M${left} ${at}H${left + width}` : `M${at} ${top}V${top + height}`;
        const where = vertical ? { x: left - 7, y: at + 4, "text-anchor": "end" }
          : { x: at, y: top + height + 17, "text-anchor": "middle" };
        place.append(make("path", { class: "gr", d }), make("text", { class: "small muted", ...where }, text));
      }
    };
    const self = { group, ax, ay };
    self.holds = (p) => p.x >= left - 6 && p.x <= left + width + 6 && p.y >= top - 6 && p.y <= top + height + 6;
    self.large = () => ax.by > 1;
    self.draw = () => {
      // Nothing beside the data is of use: the frame stays inside of what was drawn.
      for (const [a, low, size] of [[ax, left, width], [ay, top, height]]) {
        a.add = Math.min(low - a.by * low, Math.max(low + size - a.by * (low + size), a.add));
      }
      shapes.forEach((one) => one.put(ax, ay));
      places.forEach((place, k) => {
        if (!place) return;
        if (self.large()) marks(place, k ? ay : ax, k === 1); else place.innerHTML = drawn[k];
      });
      if (self.large()) data.setAttribute("clip-path", `url(#${id})`); else data.removeAttribute("clip-path");
      group.ownerSVGElement.classList.toggle("large", self.large());
    };
    self.zoom = (factor, p = { x: left + width / 2, y: top + height / 2 }) => {
      const by = Math.max(1, Math.min(200, ax.by * factor));
      for (const [a, at] of [[ax, p.x], [ay, p.y]]) {
        a.add = at - (at - a.add) * by / a.by;
        a.by = by;
      }
      self.draw();
    };
    self.move = (dx, dy) => { ax.add += dx; ay.add += dy; self.draw(); };
    self.whole = () => { for (const a of [ax, ay]) { a.by = 1; a.add = 0; } self.draw(); };
    self.at = (p) => {
      const far = (q) => Math.hypot(ax.map(q.x) + q.beside - p.x, ay.map(q.y) - p.y);
      const near = points.reduce((best, q) => (far(q) < (best ? far(best) : 22) ? q : best), null);
      if (!near) return null;
      const half = bands.filter((one) => (one.node.dataset.n || "") === near.name)
        .map((one) => [...one.band.matchAll(PAIR)].filter((m) => Math.abs(Number(m[2]) - near.x) < 0.011))
        .filter((pair) => pair.length === 2)
        .map(([a, b]) => Math.abs(ay.value(Number(a[3])) - ay.value(Number(b[3]))) / 2);
      const lines = [called(near.name), ax.text(near.x), ay.text(near.y)];
      if (half.length) lines[2] += ` (band ± ${half[0].toPrecision(2)})`;
      const bar = group.ownerSVGElement.dataset.value;
      if (near.value) lines.push(minus(bar ? bar.replace("%", near.value) : near.value));
      return lines.filter(Boolean);
    };
    return self;
  };

  // A figure with panels: pointer, keys and buttons.
  const plot = (svg) => {
    const panels = all("g.panel", svg).map(panel);
    if (!panels.length) {
      svg.addEventListener("pointermove", (event) => { const lines = told(event); if (lines) say(event, lines); else hush(); });
      svg.addEventListener("pointerleave", hush);
      return;
    }
    const of = (p) => panels.find((one) => one.holds(p));
    let grip = null;
    svg.setAttribute("tabindex", "0");
    svg.addEventListener("pointermove", (event) => {
      const p = inside(svg, event);
      if (grip) {
        grip.panel.move(p.x - grip.x, p.y - grip.y);
        Object.assign(grip, { x: p.x, y: p.y });
        return;
      }
      const lines = of(p)?.at(p) || told(event);
      if (lines) say(event, lines); else hush();
    });
    svg.addEventListener("pointerdown", (event) => {
      const p = inside(svg, event);
      const over = of(p);
      if (over?.large()) {
        grip = { panel: over, x: p.x, y: p.y };
        svg.setPointerCapture(event.pointerId);
      }
    });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { grip = null; });
    svg.addEventListener("pointerleave", hush);
    svg.addEventListener("dblclick", (event) => {
      const p = inside(svg, event);
      of(p)?.zoom(2, p);
    });
    svg.addEventListener("wheel", (event) => {
      const p = inside(svg, event);
      const over = of(p);
      // The wheel alone scrolls the page.
      if (!over || !event.ctrlKey) return;
      event.preventDefault();
      over.zoom(Math.exp(-event.deltaY / 240), p);
    }, { passive: false });
    const each = (act) => panels.forEach(act);
    const keys = {
      "+": () => each((one) => one.zoom(1.5)), "-": () => each((one) => one.zoom(1 / 1.5)), 0: () => each((one) => one.whole()),
      ArrowLeft: () => each((one) => one.move(40, 0)), ArrowRight: () => each((one) => one.move(-40, 0)),
      ArrowUp: () => each((one) => one.move(0, 40)), ArrowDown: () => each((one) => one.move(0, -40)),
    };
    svg.addEventListener("keydown", (event) => {
      const moves = event.key.startsWith("Arrow");
      if (!keys[event.key] || (moves && !panels.some((one) => one.large()))) return;
      event.preventDefault();
      keys[event.key]();
    });
    const tools = make("div", { class: "tools" });
    tools.append(button("+", "Enlarge", keys["+"]), button("−", "Reduce", keys["-"]), button("Whole", "The whole plot", keys[0]));
    svg.parentElement.querySelector("figcaption").append(tools);
  };

  // Error vectors over the volume: turned by dragging, as long as the slider says.
  const vectors = (figure) => {
    const svg = figure.querySelector("svg");
    const scene = svg.querySelector("g.scene");
    const { size, centre, scale, magnification, unit, points, corners, states, position_unit: length } = JSON.parse(
      figure.querySelector("script").textContent);
    const [width, height] = size;
    let [azimuth, elevation, enlarged] = [Math.PI / 4, Math.atan(Math.SQRT1_2), magnification];
    const project = ([x, y, z]) => {
      const [u, v, w] = [x - centre[0], y - centre[1], z - centre[2]];
      const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
      return [width / 2 + scale * (ca * u + sa * v), height / 2 - scale * (se * (ca * v - sa * u) + ce * w)];
    };
    const at = (p) => project(p).map((v) => v.toFixed(2)).join(" ");
    const tipOf = (p, e) => p.map((v, k) => v + e[k] * unit * enlarged);
    const places = () => points.map(([x, y, z]) => project([x, y, z]));
    // Before anything is turned they stand as the page has them.
    let shown = places();
    const draw = () => {
      const edges = [];
      for (let from = 0; from < 8; from += 1) {
        for (const bit of [1, 2, 4]) if (!(from & bit)) edges.push(`M${at(corners[from])}L${at(corners[from | bit])}`);
      }
      scene.replaceChildren(make("path", { class: "vol", d: edges.join("") }));
      [["x", 1], ["y", 2], ["z", 4]].forEach(([name, corner]) => {
        const [from, to] = [project(corners[0]), project(corners[corner])];
        const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        const away = 14 / Math.max(1, Math.hypot(dx, dy));
        const place = { x: to[0] + away * dx, y: to[1] + away * dy + 4, "text-anchor": "middle" };
        scene.append(make("text", { class: "muted halo", ...place }, name));
      });
      shown = places();
      scene.append(make("path", { class: "dot muteds", d: points.map((p) => `M${at(p)}h.01`).join("") }));
      states.forEach(([name, letter], k) => {
        const with_it = points.filter((p) => p[3 + 3 * k] !== null);
        const ends = with_it.map((p) => at(tipOf(p.slice(0, 3), p.slice(3 + 3 * k, 6 + 3 * k))));
        scene.append(
          make("path", { class: `vec l${letter}`, "data-n": name, d: with_it.map((p, i) => `M${at(p)}L${ends[i]}`).join("") }),
          make("path", { class: `dot vtip l${letter}`, "data-n": name, d: ends.map((end) => `M${end}h.01`).join("") }));
      });
      const words = `vectors enlarged ${Math.round(enlarged).toLocaleString("en").replaceAll(",", " ")} ×`;
      for (const note of figure.querySelectorAll(".magnified")) note.textContent = words;
    };
    const slider = make("input", { type: "range", min: "-2", max: "2", step: "0.02", value: "0" });
    slider.addEventListener("input", () => { enlarged = magnification * 10 ** Number(slider.value); draw(); });
    const label = make("label", {}, "Enlarge vectors ");
    label.append(slider);
    const turn = (da, de) => {
      azimuth += da;
      elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, elevation + de));
      draw();
    };
    const see = (a, e) => () => { [azimuth, elevation] = [a, e]; draw(); };
    const tools = make("div", { class: "tools" });
    tools.append(label, button("XY", "From above", see(0, Math.PI / 2)), button("XZ", "From the front", see(0, 0)),
      button("YZ", "From the side", see(Math.PI / 2, 0)),
      button("Whole", "As at first", () => { slider.value = "0"; enlarged = magnification; see(Math.PI / 4, Math.atan(Math.SQRT1_2))(); }));
    figure.querySelector("figcaption").append(tools);
    svg.setAttribute("tabindex", "0");
    svg.classList.add("turns");
    let grip = null;
    svg.addEventListener("pointerdown", (event) => { grip = inside(svg, event); svg.setPointerCapture(event.pointerId); });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { grip = null; });
    svg.addEventListener("pointerleave", hush);
    svg.addEventListener("pointermove", (event) => {
      const p = inside(svg, event);
      if (grip) {
        turn((grip.x - p.x) / 180, (p.y - grip.y) / 180);
        grip = p;
        return;
      }
      const far = (k) => Math.hypot(shown[k][0] - p.x, shown[k][1] - p.y);
      const near = shown.reduce((best, _, k) => (far(k) < (best < 0 ? 14 : far(best)) ? k : best), -1);
      if (near < 0) { hush(); return; }
      const of = points[near];
      const lines = [`x ${of[0]}, y ${of[1]}, z ${of[2]} ${length}`];
      states.forEach(([name], k) => {
        const e = of.slice(3 + 3 * k, 6 + 3 * k);
        if (e[0] !== null) lines.push(`${name}: ${Math.hypot(...e).toPrecision(3)} (${e.join(", ")}) ${figure.dataset.unit}`);
      });
      say(event, lines.map((line) => line.replaceAll("-", "−")));
    });
    const keys = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
    svg.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      turn(...keys[event.key]);
    });
  };

  all("figure:not(.three) > svg").forEach(plot);
  all("figure.three").forEach(vectors);

  // A name that several figures or tables tell of is picked out in all of them.
  const bar = make("div", { class: "bar" });
  const rows = all("tbody tr").filter((row) => row.cells.length > 1);
  const where = new Map();
  const seen = (name, place) => { if (name) where.set(name, (where.get(name) || new Set()).add(place)); };
  all("[data-n]").forEach((node) => namesOf(node).forEach((name) => seen(name, node.closest("figure"))));
  // A row belongs to what its cells name: "S1", or "station S1".
  const named = (row) => [...row.cells].map(({ textContent: text }) => [text, text.replace(/^(station|line) /, "")].find((name) => where.has(name)));
  rows.forEach((row) => named(row).forEach((name) => seen(name, row.closest("table"))));
  const names = [...where].filter(([, places]) => places.size > 1).map(([name]) => name);
  rows.forEach((row) => {
    const own = named(row).filter((name) => names.includes(name));
    if (own.length) row.dataset.n = [...new Set(own)].join("\t");
  });
  const choice = make("select");
  const pick = (name) => {
    choice.value = names.includes(name) ? name : "";
    const on = choice.value;
    all("[data-n]").forEach((node) => {
      // A figure or a table that knows nothing of the name stays as it is.
      const place = node.closest("figure") || node.closest("table");
      const is_own = namesOf(node).includes(on);
      node.classList.toggle("dim", Boolean(on) && where.get(on).has(place) && !is_own);
      node.classList.toggle("picked", is_own && node.tagName === "TR");
    });
  };
  if (names.length > 1) {
    choice.append(make("option", { value: "" }, "all"), ...names.map((name) => make("option", { value: name }, name)));
    choice.addEventListener("change", () => pick(choice.value));
    const label = make("label", {}, "Pick out ");
    label.append(choice);
    bar.append(label);
    document.addEventListener("click", (event) => {
      const node = event.target.closest?.("[data-n]");
      const own = node ? namesOf(node).filter((name) => names.includes(name)) : [];
      // One press picks the station, the next its line, the last none.
      if (own.length) pick(own[own.indexOf(choice.value) + 1] || "");
    });
  }

  // What fits the screen need not be moved: the hint that says so goes.
  const measure = () => all(".scroll,figure").forEach((one) => {
    one.classList.toggle("fits", one.scrollWidth <= one.clientWidth);
  });
  addEventListener("resize", measure);
  measure();
  all("figure.middle").forEach((one) => {
    one.scrollLeft = (one.scrollWidth - one.clientWidth) / 2;
  });
  // Lines of a command end between its words, and not at a hyphen of an option.
  all(".next code").forEach((one) => {
    const words = one.textContent.split(/( )/);
    one.replaceChildren(...words.map((word) => (word === " " ? word : make("span", { class: "word" }, word))));
  });

  // Before, after, or both.
  const is_state = (letter) => document.querySelector(["l", "f", "b", "o"].map((kind) => `svg .${kind}${letter}`).join(","));
  if (is_state("B") && is_state("A")) {
    const group = make("span", { role: "group", "aria-label": "Before or after" });
    const states = [["before and after", ""], ["before", "only-before"], ["after", "only-after"]];
    if (is_state("M")) states.splice(2, 0, ["between", "only-between"]);
    const buttons = states.map(([text, name]) => button(text, `Show ${text}`, () => {
      document.body.classList.remove("only-before", "only-between", "only-after");
      if (name) document.body.classList.add(name);
      buttons.forEach((one, k) => one.setAttribute("aria-pressed", String(states[k][1] === name)));
    }));
    buttons.forEach((one, k) => one.setAttribute("aria-pressed", String(k === 0)));
    group.append(...buttons);
    bar.append(group);
    // A table names the states of the figures in its cells or above its columns: rows and columns go as the figures do.
    const letters = new Map();
    for (const letter of ["B", "M", "A"]) {
      all(`svg [data-n]:is(.l${letter},.f${letter})`).forEach(({ dataset: { n } }) => letters.set(n, (letters.get(n) || "") + letter));
    }
    // What stands in two states, such as a station, is a name of none.
    const kinds = [...letters].filter(([, found]) => new Set(found).size === 1).map(([name, found]) => [name, `p${found[0]}`]);
    const kind = (text) => kinds.find(([name]) => text === name || text.endsWith(` ${name}`))?.[1];
    all("svg text[data-n]").forEach((text) => { const of = kind(text.textContent); if (of) text.classList.add(of); });
    all("table").forEach((table) => {
      [...table.tHead.rows[0].cells].forEach((head, k) => {
        const of = kind(head.firstChild?.textContent || "");
        if (of) for (const row of table.rows) row.cells[k]?.classList.add(of);
      });
    });
    rows.forEach((row) => {
      const of = [...row.cells].map((cell) => kind(cell.textContent)).find(Boolean);
      if (of) row.classList.add(of);
    });
    // So does a chapter that has the name of a state.
    all("main > h2").forEach((head) => {
      const of = kind(head.textContent);
      for (let one = head; of && one && (one === head || !one.matches("h2,.made")); one = one.nextElementSibling) one.classList.add(of);
    });
  }
  // Below the answer, above the first that it acts upon.
  const first = document.querySelector("main > h2, main > figure, main > section:not(.cards)");
  if (bar.childElementCount && first) first.before(bar);
})();
