// The page: settings from the sliders and the link, runs, plots, film.
"use strict";

const at = (id) => document.getElementById(id);
const state = { system: "ball", settings: {}, runs: null, time: 0, playing: null };
let model = null;

// ---- settings -------------------------------------------------------------------------------

const system = () => SYSTEMS[state.system];
const standard = (name) => ({ ...Object.values(SYSTEMS[name].presets)[0] });

/** A setting as its slider would give it. */
function admissible(given, slider, settings) {
  const value = Number(given);
  if (!Number.isFinite(value)) return standard(state.system)[slider.key];
  if (slider.values) {
    return slider.values.reduce((a, b) => (Math.abs(b - value) < Math.abs(a - value) ? b : a));
  }
  return Math.min(Math.max(value, slider.min), highest(slider, settings));
}

function highest(slider, settings) {
  return slider.below ? Math.min(slider.max, settings[slider.below] - slider.step) : slider.max;
}

function readLink() {
  const [name, query] = location.hash.slice(1).split("?");
  state.system = name in SYSTEMS ? name : "ball";
  state.settings = standard(state.system);
  const given = new URLSearchParams(query ?? "");
  for (const slider of system().sliders) {
    if (given.has(slider.key)) {
      state.settings[slider.key] = admissible(given.get(slider.key), slider, state.settings);
    } else if (slider.below) {
      state.settings[slider.key] = admissible(state.settings[slider.key], slider, state.settings);
    }
  }
  const { choice } = system();
  if (choice && choice.values.includes(given.get(choice.key))) {
    state.settings[choice.key] = given.get(choice.key);
  }
}

const link = () => `#${state.system}?${new URLSearchParams(state.settings)}`;

// ---- controls -------------------------------------------------------------------------------

function element(tag, properties, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

function buildTabs() {
  document.querySelector("nav").replaceChildren(
    ...Object.entries(SYSTEMS).map(([name, it]) => {
      const tab = element("button", { type: "button", onclick: () => choose(name) }, it.name);
      const selected = name === state.system;
      tab.id = `tab-${name}`;
      tab.tabIndex = selected ? 0 : -1;
      tab.setAttribute("role", "tab");
      tab.setAttribute("aria-controls", "panel");
      tab.setAttribute("aria-selected", String(selected));
      if (selected) at("panel").setAttribute("aria-labelledby", tab.id);
      return tab;
    }),
  );
}

/** Arrow keys, Home and End choose a tab, as in every list of tabs. */
function moveTab(event) {
  const names = Object.keys(SYSTEMS);
  const here = names.indexOf(state.system);
  const to = { ArrowRight: here + 1, ArrowLeft: here - 1, Home: 0, End: -1 }[event.key];
  if (to === undefined) return;
  event.preventDefault();
  choose(names.at(to % names.length));
  at(`tab-${state.system}`).focus();
}

function buildControls() {
  at("sentence").textContent = system().sentence;
  const names = Object.keys(system().presets);
  at("preset").replaceChildren(element("option", { value: "" }, "\u2013"));
  at("preset").append(...names.map((name) => element("option", { value: name }, name)));
  at("sliders").replaceChildren(...system().sliders.map(buildSlider));
  const { choice } = system();
  if (choice) {
    const select = element("select", {
      onchange: () => change(choice.key, select.value),
    }, ...choice.values.map((value) => element("option", { value }, value)));
    select.value = state.settings[choice.key];
    at("sliders").append(element("label", { className: "slider" }, choice.label, select));
  }
  at("plots").replaceChildren(...system().plots.map(({ label: text }) => {
    const canvas = element("canvas", {});
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", text);
    return canvas;
  }));
  at("reference-key").hidden = state.system !== "tracker";
  showSettings();
}

function buildSlider(slider) {
  const input = element("input", { type: "range", name: slider.key, id: `slider-${slider.key}` });
  const places = slider.values
    ? { min: 0, max: slider.values.length - 1, step: 1 }
    : { min: slider.min, max: slider.max, step: slider.step };
  Object.assign(input, places);
  input.oninput = () => {
    const value = slider.values ? slider.values[input.valueAsNumber] : input.valueAsNumber;
    change(slider.key, value);
  };
  // the name of the slider is its label, its value the text with the unit; nothing is said twice
  const output = element("output", {});
  output.setAttribute("aria-hidden", "true");
  return element("div", { className: "slider" },
    element("label", { htmlFor: input.id }, slider.label), output, input);
}

function showSettings() {
  for (const slider of system().sliders) {
    const input = document.querySelector(`input[name="${slider.key}"]`);
    const value = state.settings[slider.key];
    if (slider.below) input.max = highest(slider, state.settings);
    input.value = slider.values ? slider.values.indexOf(value) : value;
    const text = `${Number(value.toPrecision(4))} ${slider.unit}`.trim();
    input.previousSibling.textContent = text;
    input.setAttribute("aria-valuetext", text);
  }
  const same = Object.entries(system().presets).find(([, preset]) =>
    Object.entries(preset).every(([key, value]) => state.settings[key] === value));
  at("preset").value = same ? same[0] : "";
}

function change(key, value) {
  state.settings[key] = value;
  for (const slider of system().sliders) {
    if (slider.below) {
      state.settings[slider.key] = admissible(state.settings[slider.key], slider, state.settings);
    }
  }
  showSettings();
  compute();
}

function choose(name, settings = standard(name)) {
  state.system = name;
  state.settings = { ...settings };
  stop();
  buildTabs();
  buildControls();
  compute();
}

// ---- runs and what is drawn of them -----------------------------------------------------------

function compute() {
  const p = state.settings;
  const n = Math.min(model.steps, Math.round(p.end / p.h));
  const runs = system().runs(model, p, n);
  if (!runs.implicit || !runs.explicit) {
    at("message").textContent = "These settings were refused; the plots show the last run.";
    return;
  }
  at("message").textContent =
    n * p.h < p.end - p.h ? `Shown up to ${(n * p.h).toPrecision(3)} s: ${n} steps at most.` : "";
  state.runs = runs;
  state.time = Math.min(state.time, end());
  history.replaceState(null, "", link());
  showFacts();
  draw();
}

const end = () => state.runs.implicit.t[state.runs.implicit.n - 1];

/** The part of the time axis that is shown. */
function shown() {
  if (!at("zoom").checked) return [0, end()];
  const rest = restTime(state.runs.implicit) ?? end();
  const half = 0.06 * end();
  const middle = Math.min(Math.max(rest, half), end() - half);
  return [middle - half, middle + half];
}

const index = (run, t) => Math.min(run.n - 1, Math.max(0, Math.round(t / state.settings.h)));

function lineOf(run, plot, colour, [from, to], more = {}) {
  const { h } = state.settings;
  const y = plot.y(run);
  const impact = (k) => k > 0 && y[k - 1] < 0 && y[k] > 0 && run.x[k - 1] <= -2 * h * y[k - 1];
  return {
    x: plot.x ? plot.x(run) : run.t, y, colour, held: plot.held,
    from: index(run, from), to: index(run, to) + 1,
    gap: plot.broken && run.x.length ? impact : null, ...more,
  };
}

function linesOf(plot, window) {
  const { implicit, explicit } = state.runs;
  const lines = [
    lineOf(explicit, plot, COLOURS.explicit, window, { width: 1 }),
    lineOf(implicit, plot, COLOURS.implicit, window),
  ];
  if (state.system === "tracker" && plot.reference) {
    const reference = { ...implicit, x: implicit.x_ref, xdot: implicit.xdot_ref };
    lines.push(lineOf(reference, plot, COLOURS.reference, window, { dash: [5, 4] }));
  }
  return lines;
}

function draw() {
  if (!state.runs) return;
  const window = shown();
  document.querySelectorAll("#plots canvas").forEach((canvas, j) => {
    const plot = system().plots[j];
    drawPlot(canvas, {
      lines: linesOf(plot, window),
      xRange: plot.x ? null : window,
      xLabel: plot.below ?? "time t (s)",
      yLabel: plot.label,
      cursor: plot.x ? null : state.time,
      least: plot.least,
    });
  });
  drawFilm();
}

function drawFilm() {
  const { implicit, explicit } = state.runs;
  const k = index(implicit, state.time);
  const masses = [
    { x: implicit.x[k], colour: COLOURS.implicit },
    { x: explicit.x[k], colour: COLOURS.explicit },
  ];
  if (state.system === "tracker") {
    masses.push({ x: implicit.x_ref[k], colour: COLOURS.reference, hollow: true });
  }
  const [from, to] = shown().map((t) => index(implicit, t));
  const top = Math.max(...[implicit, explicit].map((run) => run.x.subarray(from, to + 1).reduce(
    (a, b) => Math.max(a, b), 1e-9)));
  drawStage(at("stage"), masses, top);
  at("now").textContent = `${state.time.toFixed(3)} s`;
  at("time").value = Math.round((1000 * state.time) / end());
  at("time").setAttribute("aria-valuetext", at("now").textContent);
}

function seconds(value) {
  return value === null ? `not within ${Number(end().toPrecision(3))} s` : `${Number(value.toPrecision(6))} s`;
}

const largest = (values) => values.reduce((a, b) => Math.max(a, Math.abs(b)), 0);

/** Below this part of what it is computed from, a number is rounding and counts as 0. */
const ROUNDING = 16 * Number.EPSILON;

function variation({ u: values, x, xdot }) {
  const first = Math.floor(0.9 * (values.length - 1));
  const { h } = state.settings;
  // a control is solved for from a position and a velocity one step ahead
  const least = ROUNDING * (largest(values) + largest(xdot) / h + largest(x) / (h * h));
  let sum = 0;
  for (let k = first + 1; k < values.length; k += 1) {
    const change = Math.abs(values[k] - values[k - 1]);
    if (change > least) sum += change;
  }
  return sum / ((values.length - 1 - first) * h);
}

function fastest(run) {
  const found = largest(run.xdot.subarray(Math.floor(0.9 * run.n)));
  return found > ROUNDING * largest(run.xdot) ? found : 0;
}

const short = (value) => (value === 0 ? "0" : value.toPrecision(3));

function showFacts() {
  const { implicit, explicit } = state.runs;
  const both = (name, of) => [name, of(implicit), of(explicit)];
  const rows = [
    ["", "implicit", "explicit"],
    both("exactly at rest from", (run) => seconds(restTime(run))),
    both("largest |x'|, last tenth", (run) => `${short(fastest(run))} m/s`),
  ];
  if (state.system !== "ball") {
    rows.push(both("changes of u per second, last tenth", (run) => `${short(variation(run))} m/s\u00b2 per s`));
  }
  if (system().exact) {
    const [name, value] = system().exact(state.settings);
    rows.push([name, seconds(value), ""]);
  }
  at("facts").replaceChildren(...rows.map(([head, ...cells]) =>
    element("tr", {}, element("th", { scope: "row" }, head),
      ...cells.map((cell) => element("td", {}, cell)))));
}

// ---- film -----------------------------------------------------------------------------------

function stop() {
  if (state.playing !== null) cancelAnimationFrame(state.playing);
  state.playing = null;
  at("play").textContent = "Play";
}

function play() {
  if (state.playing !== null) return stop();
  const [from, to] = shown();
  if (state.time >= to - 1e-9 || state.time < from) state.time = from;
  let last = null;
  at("play").textContent = "Pause";
  const frame = (now) => {
    const passed = last === null ? 0 : Math.min(now - last, 100) / 1000;
    last = now;
    state.time = Math.min(state.time + passed * Number(at("speed").value), to);
    draw();
    if (state.time >= to) stop();
    else state.playing = requestAnimationFrame(frame);
  };
  state.playing = requestAnimationFrame(frame);
}

// ---- begin ----------------------------------------------------------------------------------

async function begin() {
  const binary = Uint8Array.from(atob(ZIVI_WASM), (letter) => letter.charCodeAt(0));
  model = await loadModel(binary);
  readLink();
  choose(state.system, state.settings);
  at("preset").onchange = () => {
    const preset = system().presets[at("preset").value];
    if (preset) choose(state.system, preset);
  };
  at("reset").onclick = () => choose(state.system);
  at("link").onclick = async () => {
    try {
      await navigator.clipboard.writeText(location.href);
      at("message").textContent = "The link carries the settings; it is copied.";
    } catch {
      at("message").textContent = "The address of this page carries the settings.";
    }
  };
  at("zoom").onchange = () => {
    const [from, to] = shown();
    if (state.time < from || state.time > to) state.time = from;
    draw();
  };
  at("play").onclick = play;
  document.querySelector("nav").onkeydown = moveTab;
  at("time").oninput = () => {
    stop();
    state.time = (at("time").valueAsNumber / 1000) * end();
    draw();
  };
  addEventListener("resize", draw);
  addEventListener("hashchange", () => {
    readLink();
    choose(state.system, state.settings);
  });
  document.body.dataset.ready = "yes";
}

begin().catch((error) => {
  at("message").textContent = `This page needs a browser with WebAssembly (${error.message}).`;
});
