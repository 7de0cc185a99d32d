// Runs of zivi-core in WebAssembly (crates/zivi-wasm), as columns.
"use strict";

const COLUMNS = [
  "x", "xdot", "s", "v", "x_ref", "xdot_ref", "u",
  "lambda_s", "lambda_v", "lambda_sr", "lambda_vr", "lambda_es", "lambda_ev",
];

/** Gives the functions that run, from the bytes of zivi.wasm. */
async function loadModel(bytes) {
  const { instance } = await WebAssembly.instantiate(bytes, {});
  const wasm = instance.exports;
  const width = wasm.width();
  const steps = wasm.capacity() - 1;

  function columns(rows, h) {
    const table = new Float64Array(wasm.memory.buffer, wasm.table(), rows * width);
    const run = { n: rows, t: Float64Array.from({ length: rows }, (_, k) => k * h) };
    COLUMNS.forEach((name, j) => {
      run[name] = Float64Array.from({ length: rows }, (_, k) => table[k * width + j]);
    });
    return run;
  }

  /** Samples of a run of `n` steps of `h`; null where a setting is refused. */
  function made(rows, h) {
    return rows > 0 ? columns(rows, h) : null;
  }

  return {
    steps,
    ball: (p, explicit, n) =>
      made(wasm.ball(explicit ? 1 : 0, n, p.h, p.e, -p.g, p.x, p.xdot), p.h),
    regulator: (p, explicit, n) =>
      made(wasm.regulator(explicit ? 1 : 0, n, p.h, p.e, p.mu1, p.mu2, p.force, p.x, p.xdot), p.h),
    tracker: (p, kind, n) =>
      made(
        wasm.tracker(
          ["positive", "nearest", "explicit"].indexOf(kind), n, p.h, p.e, p.mu1, p.mu2,
          -p.g, -p.g + p.unknown, -p.g_ref, p.x, p.xdot, p.x_ref, p.xdot_ref,
        ),
        p.h,
      ),
  };
}

/** First time from which the mass stays exactly at rest, or null. */
function restTime(run) {
  let k = run.n;
  while (k > 0 && run.x[k - 1] === 0 && run.xdot[k - 1] === 0) k -= 1;
  return k < run.n ? run.t[k] : null;
}

if (typeof module !== "undefined") module.exports = { COLUMNS, loadModel, restTime };
