// What the page shows of each system: sliders, presets, runs, plots, facts.
"use strict";

const slider = (key, label, min, max, step, unit) => ({ key, label, min, max, step, unit });
const E = slider("e", "restitution e", 0.05, 0.95, 0.01, "");
const H = { key: "h", label: "step h", values: [2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2], unit: "s" };
const X = slider("x", "position x(0)", 0, 8, 0.1, "m");
const XDOT = slider("xdot", "velocity x'(0)", -8, 8, 0.1, "m/s");
const END = (max) => slider("end", "shown up to", 0.5, max, 0.1, "s");
const MU1 = (max) => slider("mu1", "gain mu1", 1, max, 0.5, "m/s\u00b2");
const MU2 = (max) => ({ ...slider("mu2", "gain mu2", 0.5, max, 0.5, "m/s\u00b2"), below: "mu1" });

/** Zeno point of a free fall under gravity `g` (closed form), null where there is none. */
function zenoPoint(x, xdot, g, e) {
  const speed = Math.sqrt(xdot * xdot + 2 * g * x);
  return (xdot + speed) / g + (2 * e * speed) / (g * (1 - e));
}

const difference = (a, b) => a.map((value, k) => value - b[k]);
const over = (name, label) => ({ label, y: (run) => run[name] });
// `least` is the smallest range of an axis: below it, rounding would fill the plot
const POSITION = { ...over("x", "position x (m)"), reference: "x_ref", least: 1e-9 };
const VELOCITY = { ...over("xdot", "velocity x' (m/s)"), reference: "xdot_ref", broken: true, least: 1e-6 };
const CONTROL = { ...over("u", "control u (m/s\u00b2)"), held: true, least: 1 };
const PLANE = { label: "v (m/s)", below: "s (m)", least: 1e-6, x: (run) => run.s, y: (run) => run.v };

const SYSTEMS = {
  ball: {
    name: "Ball",
    sentence: "A ball bounces infinitely often in finite time. With implicit signs the scheme passes that " +
      "point and rests exactly; with explicit signs the same step goes on trembling for ever.",
    sliders: [E, H, X, XDOT, slider("g", "gravity", 1, 25, 0.1, "m/s\u00b2"), END(4)],
    presets: {
      "The paper's ball": { h: 1e-3, e: 0.59 / 1.41, g: 9.81, x: 1, xdot: 6, end: 3 },
      "Coarse steps": { h: 1e-2, e: 0.59 / 1.41, g: 9.81, x: 1, xdot: 6, end: 3 },
      "Lively": { h: 5e-4, e: 0.8, g: 9.81, x: 1, xdot: 0, end: 4 },
      "Nearly plastic": { h: 2e-3, e: 0.05, g: 9.81, x: 2, xdot: 0, end: 1.5 },
    },
    runs: (model, p, n) => ({ implicit: model.ball(p, false, n), explicit: model.ball(p, true, n) }),
    plots: [POSITION, VELOCITY, PLANE, { ...over("lambda_s", "\u03bb in sgn s"), held: true, least: 1 }],
    exact: (p) => ["exact Zeno point", zenoPoint(p.x, p.xdot, p.g, p.e)],
  },
  regulator: {
    name: "Regulator",
    sentence: "A twisting regulator brings a mass to rest at the wall in finite time. It always pushes towards " +
      "the wall, so explicit signs rest as well; what they cost a mass in the air, the tracker shows.",
    sliders: [MU1(20), MU2(15), E, H, X, XDOT, slider("force", "force F", -3, 3, 0.1, "m/s\u00b2"), END(4)],
    presets: {
      "Figure 5": { h: 1e-3, e: 1 / 3, mu1: 3, mu2: 2, force: 0, x: 1, xdot: 0, end: 2.5 },
      "Slow sampling": { h: 2e-2, e: 0.5, mu1: 3, mu2: 2, force: 0, x: 1, xdot: 0, end: 4 },
      "Under a force": { h: 1e-3, e: 0.33, mu1: 8, mu2: 4, force: 2, x: 2, xdot: 3, end: 3 },
    },
    runs: (model, p, n) => ({
      implicit: model.regulator(p, false, n),
      explicit: model.regulator(p, true, n),
    }),
    plots: [POSITION, VELOCITY, PLANE, CONTROL],
  },
  tracker: {
    name: "Tracker",
    sentence: "A mass follows a bouncing reference through its Zeno point. On a reference in the air, or under " +
      "a force it does not know, explicit signs switch in nearly every period (see the presets).",
    sliders: [
      MU1(60), MU2(50), E, H, X, XDOT,
      slider("x_ref", "reference x(0)", 0, 8, 0.1, "m"),
      slider("xdot_ref", "reference x'(0)", -8, 8, 0.1, "m/s"),
      slider("g", "gravity", 1, 25, 0.1, "m/s\u00b2"),
      slider("g_ref", "the reference's", 1, 25, 0.1, "m/s\u00b2"),
      slider("unknown", "unknown force", -5, 5, 0.1, "m/s\u00b2"), END(4),
    ],
    choice: { key: "branch", label: "branch", values: ["positive", "nearest"] },
    presets: {
      "The paper's problem": {
        h: 1e-3, e: 1 / 3, mu1: 30, mu2: 17, g: 9.81, g_ref: 19.81, unknown: 0, x: 6, xdot: 5,
        x_ref: 3, xdot_ref: 3, end: 1.6, branch: "positive",
      },
      "In the air": {
        h: 5e-3, e: 1 / 3, mu1: 30, mu2: 17, g: 9.81, g_ref: 9.81, unknown: 0, x: 3, xdot: 7,
        x_ref: 3, xdot_ref: 8, end: 1.2, branch: "positive",
      },
      "A force it does not know": {
        h: 1e-3, e: 1 / 3, mu1: 30, mu2: 17, g: 9.81, g_ref: 19.81, unknown: 1.5, x: 6, xdot: 5,
        x_ref: 3, xdot_ref: 3, end: 2, branch: "positive",
      },
      "A lively reference": {
        h: 1e-3, e: 0.8, mu1: 30, mu2: 17, g: 9.81, g_ref: 9.81, unknown: 0, x: 2, xdot: 0,
        x_ref: 1, xdot_ref: 0, end: 4, branch: "nearest",
      },
    },
    runs: (model, p, n) => ({
      implicit: model.tracker(p, p.branch, n),
      explicit: model.tracker(p, "explicit", n),
    }),
    plots: [
      POSITION, VELOCITY,
      { label: "x \u2212 reference (m)", least: 1e-9, y: (run) => difference(run.x, run.x_ref) },
      CONTROL,
    ],
    exact: (p) => ["the reference's Zeno point, exact", zenoPoint(p.x_ref, p.xdot_ref, p.g_ref, p.e)],
  },
};
