"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const box = document.getElementById("frame");
  const strips = []; // {group, strip, cells, cursor} in the order of the page
  const DASHES = ["", "7 3", "2 3", "8 3 2 3"];

  const element = (tag, attributes = {}, ...children) => {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    made.append(...children);
    return made;
  };
  const drawn = (tag, attributes) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    return made;
  };
  const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replaceAll("'", `'"'"'`)}'`);

  // A page on disk lies in its run's directory.
  const run = data.run ?? (location.protocol === "file:"
    ? decodeURIComponent(location.pathname).replace(/^\/(?=[A-Za-z]:)/, "").replace(/\/[^/]*$/, "") || "/"
    : "RUN");

  // A page that a server gives out knows where recordings open; one tab is enough for all of them.
  const VIEWER = "vfoa-viewer";
  const opens = ({ strip }, i) => strip.recording &&
    `open?${new URLSearchParams({ recording: strip.recording, frame: strip.frames[i] })}`;

  const said = (state) => ["correct", "unscored"].includes(state) ? state : `wrong: ${state.replaceAll("_", " ")}`;
  const kind = (state) => ["correct", "unscored"].includes(state) ? state : "wrong";
  const state = ({ strip }, i) => data.states[strip.states[i]];
  const truth = ({ strip }, i) => strip.truth[i] ?? "not annotated";
  const predicted = ({ strip }, i) => strip.predicted[i] ?? "no prediction";
  const number = (value) => (value === null ? "–" : (value / 1000).toFixed(3));

  // The box of one frame

  let shown = null;
  function show(one, i) {
    shown?.cell.classList.remove("at");
    shown = { one, i, cell: one.cells[i] };
    shown.cell.classList.add("at");
    const { group, strip } = one;
    const frame = strip.frames[i];
    const command =
      `vfoa view ${quoted(run)} --clip ${quoted(group.clip)} --config ${quoted(strip.config)} --frame ${frame}`;
    box.replaceChildren(element("div", {},
      element("div", {},
        element("h3", {}, `Frame ${frame} – ${said(state(one, i))}`),
        element("p", {}, `${group.clip}, ${group.subject}, ${strip.config}`),
        element("p", {}, `Truth: ${truth(one, i)}. Predicted: ${predicted(one, i)}.`, ...why(one, i)),
        element("code", {}, command),
        ...link(one, i)),
      ...thumbnail(one, i),
      values(one, i)));
    box.hidden = false;
    for (const other of strips) moveCursor(other, other.group === group ? other.strip.frames.indexOf(frame) : -1);
  }

  function why(one, i) {
    const words = data.error_types[state(one, i)];
    return words ? [element("br"), `${words[0].toUpperCase()}${words.slice(1)}.`] : [];
  }

  // The picture of a wrong frame: what was seen, the truth (solid, thick, a tick) and the answer (dashed, a cross)

  function thumbnail(one, i) {
    const frame = one.strip.frames[i];
    const seen = one.strip.seen[frame];
    const picture = data.pictures[one.group.clip]?.[frame];
    if (!seen || !picture) return [];
    const [width, height] = seen.size;
    const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "thumbnail" });
    svg.setAttribute("aria-label", `The left image of frame ${frame}: boxes, the head of ${one.group.subject}, cones; ` +
      `truth ${truth(one, i)}, predicted ${predicted(one, i)}`);
    svg.append(drawn("image", { href: picture, width, height }));
    const roles = seen.boxes.map(([id, name]) =>
      id === seen.focus ? "predicted" : name === one.strip.truth[i] ? "truth" : "other");
    const inOrder = ["other", "truth", "predicted"].flatMap((role) =>
      seen.boxes.filter((_, at) => roles[at] === role).map(([, name, box]) => [role, name, box]));
    const texts = [];
    const outline = (kind, text, [left, top, right, bottom]) => {
      const place = { x: left, y: top, width: right - left, height: bottom - top };
      svg.append(drawn("rect", { class: "casing", ...place }), drawn("rect", { class: kind, ...place }));
      const low = Math.min(Math.max(top - 3, 11), height - 3);
      const label = drawn("text", { class: kind, x: Math.max(2, Math.min(left, width - 6.2 * text.length)), y: low });
      label.append(text);
      texts.push(label);
    };
    for (const [role, name, box] of inOrder) {
      if (role === "other") outline(role, name === one.group.subject ? "" : name, box);
    }
    for (const [cue, line] of seen.lines) {
      const points = Array.from({ length: line.length / 2 }, (_, k) => `${line[2 * k]},${line[2 * k + 1]}`).join(" ");
      svg.append(drawn("polyline", { class: cue, points }));
    }
    if (seen.head) outline("face", one.group.subject, seen.head);
    for (const [role, name, box] of inOrder) {
      if (role !== "other") outline(role, `${role === "truth" ? "✓ truth" : "✗ predicted"}: ${name}`, box);
    }
    svg.append(...texts);
    return [element("figure", {}, svg, element("figcaption", {}, "✓ solid: truth; ✗ dashed: answer; yellow: gaze; blue, dotted: head"))];
  }

  function link(one, i) {
    const address = opens(one, i);
    if (!address) return [];
    return [element("p", {}, element("a", { href: address, target: VIEWER }, "Open the recording at this frame"))];
  }

  function values({ strip }, i) {
    const head = element("tr", {}, ...["Attention", "", "total", "gaze", "head"].map((text, column) =>
      element(text ? "th" : "td", text ? { scope: "col", class: column ? "n" : "" } : {}, text)));
    const known = Object.entries(strip.values).filter(([, [, , total]]) => total[i] !== null);
    const told = ([name, [, , total]]) => total[i] > 0 || name === strip.truth[i] || name === strip.predicted[i];
    const rows = known.filter(told)
      .sort(([, a], [, b]) => b[2][i] - a[2][i])
      .map(([name, [gaze, looking, total]]) => {
        const level = element("meter", { min: 0, max: 1000, value: total[i], "aria-label": `attention to ${name}` });
        const roles = [name === strip.truth[i] ? "truth" : "", name === strip.predicted[i] ? "predicted" : ""];
        const role = roles.filter(Boolean).join(", ");
        const title = element("th", { scope: "row" }, name, element("small", {}, role && ` (${role})`));
        return element("tr", {}, title, element("td", {}, level),
          ...[total, gaze, looking].map((list) => element("td", { class: "n" }, number(list[i]))));
      });
    const others = known.filter((each) => !told(each)).map(([name]) => name);
    const rest = others.length ? `No attention to ${others.join(", ")}.` : known.length ? "" : "No attention values.";
    return element("div", {}, ...(rows.length ? [element("table", {}, head, ...rows)] : []), element("p", { class: "small" }, rest));
  }

  function close() {
    shown?.cell.classList.remove("at");
    shown = null;
    box.hidden = true;
    strips.forEach((one) => moveCursor(one, -1));
  }

  // Strips: one Tab stop each, arrow keys within

  function drawStrip(group, strip) {
    const one = { group, strip, cells: [], cursor: null };
    const place = strips.push(one) - 1;
    strip.frames.forEach((frame, i) => {
      const outcome = state(one, i);
      const cell = element("button", {
        type: "button", class: `cell ${kind(outcome)}`, tabindex: i ? -1 : 0,
        "data-clip": group.clip, "data-subject": group.subject, "data-config": strip.config, "data-frame": frame,
        "aria-label": `frame ${frame}, ${said(outcome)}, truth ${truth(one, i)}, predicted ${predicted(one, i)}`,
      }, data.letters[outcome]);
      cell.addEventListener("focus", () => {
        one.cells.forEach((other) => { other.tabIndex = other === cell ? 0 : -1; });
        show(one, i);
      });
      cell.addEventListener("pointerenter", () => show(one, i));
      cell.addEventListener("click", () => {
        cell.focus(); // Safari does not focus a button that is clicked
        const address = opens(one, i);
        if (address) window.open(address, VIEWER);
      });
      one.cells.push(cell);
    });
    const cells = element("div", {
      class: "cells", role: "group", "aria-label": `${group.clip}, ${group.subject}, ${strip.config}`,
    }, ...one.cells);
    cells.addEventListener("keydown", (event) => onKey(event, place));
    return element("div", { class: "strip" }, element("span", {}, strip.config), cells);
  }

  function onKey(event, place) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const one = strips[place];
    const i = one.cells.indexOf(event.target);
    const wrong = (each) => each.classList.contains("wrong");
    const neighbour = (step) => {
      const next = strips[place + step];
      return next && (next.cells[next.strip.frames.indexOf(one.strip.frames[i])] ?? next.cells[0]);
    };
    const goals = {
      ArrowRight: () => one.cells[i + 1],
      ArrowLeft: () => one.cells[i - 1],
      ArrowDown: () => neighbour(1),
      ArrowUp: () => neighbour(-1),
      Home: () => one.cells[0],
      End: () => one.cells.at(-1),
      n: () => one.cells.slice(i + 1).find(wrong),
      p: () => one.cells.slice(0, i).findLast(wrong),
    };
    const goal = goals[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!goal) return;
    event.preventDefault();
    goal()?.focus();
  }

  // Curves: a band of colour where the truth is one target, a line per target

  function drawCurves(group, ones) {
    const names = Object.keys(group.colours);
    const look = (name) => ({ stroke: group.colours[name], "stroke-dasharray": DASHES[names.indexOf(name) % DASHES.length] });
    const key = element("div", { class: "key" }, ...names.filter((name) => name !== "none" && name !== "ignore").map((name) => {
      const sample = drawn("svg", { viewBox: "0 0 28 8", "aria-hidden": "true" });
      sample.append(drawn("path", { d: "M0 4H28", "stroke-width": 2, fill: "none", ...look(name) }));
      return element("span", {}, sample, name);
    }));
    const charts = ones.map((one) => {
      const { strip } = one;
      const n = strip.frames.length;
      const svg = drawn("svg", { viewBox: `0 0 ${n} 1`, preserveAspectRatio: "none", role: "img" });
      svg.setAttribute("aria-label", `Attention of ${group.subject} over frames ${strip.frames[0]} to ` +
        `${strip.frames[n - 1]} of ${group.clip}, ${strip.config}; the values are in the strip's cells`);
      const plot = element("div", { class: "plot" }, svg);
      for (const [first, end, name] of spans(strip.truth)) {
        if (name === null) continue;
        svg.append(drawn("rect", { x: first, y: 0, width: end - first, height: 1, fill: group.colours[name], opacity: .28 }));
        const label = element("i", { title: name }, name);
        label.style.left = `${100 * first / n}%`;
        label.style.width = `${100 * (end - first) / n}%`;
        plot.append(label);
      }
      for (const [name, [, , total]] of Object.entries(strip.values)) {
        for (const line of lines(total)) svg.append(drawn("polyline", { points: line, ...look(name) }));
      }
      one.cursor = drawn("path", { class: "cursor", d: "" });
      svg.append(one.cursor);
      svg.addEventListener("pointermove", (event) => {
        const bounds = svg.getBoundingClientRect();
        const i = Math.floor(n * (event.clientX - bounds.left) / bounds.width);
        show(one, Math.min(Math.max(i, 0), n - 1));
      });
      return element("div", { class: "curve" }, element("p", {}, strip.config), plot);
    });
    return [key, ...charts];
  }

  function spans(list) {
    const found = [];
    list.forEach((name, i) => {
      if (i && name === list[i - 1]) found.at(-1)[1] = i + 1;
      else found.push([i, i + 1, name]);
    });
    return found;
  }

  /** Points of the lines through the known values; a lone one is a step as wide as its frame. */
  function lines(total) {
    return spans(total.map((value) => value !== null)).filter(([, , known]) => known).map(([first, end]) => {
      const y = (i) => 0.98 - 0.96 * total[i] / 1000;
      if (end - first === 1) return `${first},${y(first)} ${end},${y(first)}`;
      return Array.from({ length: end - first }, (_, k) => `${first + k + .5},${y(first + k)}`).join(" ");
    });
  }

  function moveCursor(one, i) {
    one.cursor?.setAttribute("d", i < 0 ? "" : `M${i + .5} 0V1`);
  }

  const span = ({ frames }) => element("small", {}, ` frames ${frames[0]} to ${frames.at(-1)}`);

  // The page

  const place = document.getElementById("strips");
  data.groups.forEach((group, at) => {
    const rows = group.strips.map((strip) => drawStrip(group, strip));
    const ones = strips.slice(-rows.length);
    const curves = element("details", {}, element("summary", {}, "Attention over frames, from 0 to 1 (shaded: the truth)"));
    curves.addEventListener("toggle", () => {
      if (!curves.open || curves.childElementCount > 1) return;
      curves.append(...drawCurves(group, ones));
      if (shown) show(shown.one, shown.i);
    });
    place.append(element("section", {}, element("h3", {}, `${group.clip} – ${group.subject}`, span(ones[0].strip)), ...rows, curves));
    curves.open = at === 0;
  });
  if (!data.groups.length) place.append(element("p", {}, "Nobody who has a name or a label."));
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") close(); });
})();
