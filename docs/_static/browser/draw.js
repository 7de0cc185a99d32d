// Plots and the film, on canvases.
"use strict";

const COLOURS = { implicit: "#0072b2", explicit: "#d55e00", reference: "#009e73" };
const FONT = '12px system-ui, "DejaVu Sans", sans-serif';

/** A canvas as large as its box, in pixels of the screen. */
function sheet(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { width, height } = canvas.getBoundingClientRect();
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  return { pen, width, height };
}

/** Round numbers in a range, about `count` of them. */
function ticks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((it) => it * power).find((it) => it >= raw);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step + 0);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

/** Smallest and largest of what is shown, with some room. */
function range(lines, of, least) {
  let low = Infinity, high = -Infinity;
  for (const line of lines) {
    for (let k = line.from; k < line.to; k += 1) {
      const value = line[of][k];
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (!(low <= high)) return [-1, 1];
  const half = Math.max(0.55 * (high - low), 0.5 * least);
  return [(low + high) / 2 - half, (low + high) / 2 + half];
}

/** A power of a thousand that leaves few digits in a range, and what to write behind the unit. */
function scaled(low, high) {
  const size = Math.max(Math.abs(low), Math.abs(high));
  const power = size < 0.05 ? 3 * Math.floor(Math.log10(size * 2) / 3) : 0;
  return { factor: 10 ** -power, note: power ? ` \u00d7 1e${power}` : "" };
}

/** Draws lines `{x, y, from, to, colour, dash, held, gap}` and a cursor. */
function drawPlot(canvas, { lines, xRange, xLabel, yLabel, cursor, least }) {
  const { pen, width, height } = sheet(canvas);
  const box = { left: 58, right: width - 14, top: 8, bottom: height - 34 };
  const [x0, x1] = xRange ?? range(lines, "x", least);
  const [y0, y1] = range(lines, "y", least);
  const px = (x) => box.left + ((x - x0) / (x1 - x0)) * (box.right - box.left);
  const py = (y) => box.bottom - ((y - y0) / (y1 - y0)) * (box.bottom - box.top);
  pen.lineWidth = 1;
  pen.strokeStyle = "#e6e9ed";
  pen.fillStyle = "#333d47";
  pen.textAlign = "center";
  pen.textBaseline = "top";
  const ofX = xRange ? { factor: 1, note: "" } : scaled(x0, x1);
  const across = ticks(x0 * ofX.factor, x1 * ofX.factor, Math.max(3, (box.right - box.left) / 80));
  for (const value of across.found) {
    const x = px(value / ofX.factor);
    rule(pen, x, box.top, x, box.bottom);
    pen.fillText(value.toFixed(across.digits), x, box.bottom + 4);
  }
  pen.textAlign = "right";
  pen.textBaseline = "middle";
  const ofY = scaled(y0, y1);
  const up = ticks(y0 * ofY.factor, y1 * ofY.factor, 4);
  for (const value of up.found) {
    const y = py(value / ofY.factor);
    rule(pen, box.left, y, box.right, y);
    pen.fillText(value.toFixed(up.digits), box.left - 5, y);
  }
  pen.textAlign = "center";
  pen.textBaseline = "bottom";
  pen.fillText(xLabel + ofX.note, (box.left + box.right) / 2, height);
  pen.save();
  pen.translate(11, (box.top + box.bottom) / 2);
  pen.rotate(-Math.PI / 2);
  pen.textBaseline = "middle";
  pen.fillText(yLabel + ofY.note, 0, 0);
  pen.restore();
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
  pen.clip();
  for (const line of lines) stroke(pen, line, px, py);
  if (cursor !== null && cursor !== undefined) {
    pen.strokeStyle = "#333d47";
    pen.lineWidth = 1;
    rule(pen, px(cursor), box.top, px(cursor), box.bottom);
  }
  pen.restore();
}

function rule(pen, x0, y0, x1, y1) {
  pen.beginPath();
  pen.moveTo(x0, y0);
  pen.lineTo(x1, y1);
  pen.stroke();
}

function stroke(pen, line, px, py) {
  pen.strokeStyle = line.colour;
  pen.lineWidth = line.width ?? 1.6;
  pen.setLineDash(line.dash ?? []);
  pen.beginPath();
  let down = false;
  for (let k = line.from; k < line.to; k += 1) {
    if (line.gap && line.gap(k)) down = false;
    const x = px(line.x[k]), y = py(line.y[k]);
    if (!Number.isFinite(y)) continue;
    if (down && line.held) pen.lineTo(x, py(line.y[k - 1]));
    if (down) pen.lineTo(x, y);
    else pen.moveTo(x, y);
    down = true;
  }
  pen.stroke();
  pen.setLineDash([]);
}

function metres(length) {
  const [factor, unit] = length >= 0.1 ? [1, "m"] : length >= 1e-4 ? [1e3, "mm"] : [1e6, "\u00b5m"];
  return `${Number((length * factor).toPrecision(2))} ${unit}`;
}

/** Draws the masses `{x, colour, hollow}` above the wall, `top` metres to the upper edge. */
function drawStage(canvas, masses, top) {
  const { pen, width, height } = sheet(canvas);
  const radius = Math.min(11, width / (3 * masses.length));
  const floor = height - 16;
  const scale = (floor - 2 * radius - 10) / Math.max(top, 1e-9);
  pen.fillStyle = "#d5d9de";
  pen.fillRect(0, floor, width, 16);
  pen.fillStyle = "#333d47";
  pen.textAlign = "left";
  pen.textBaseline = "top";
  pen.fillText(metres(top), 6, 4);
  masses.forEach(({ x, colour, hollow }, j) => {
    pen.beginPath();
    pen.arc((width * (j + 1)) / (masses.length + 1), floor - radius - x * scale, radius - 1, 0, 7);
    pen.fillStyle = pen.strokeStyle = colour;
    pen.lineWidth = 2;
    if (hollow) pen.stroke();
    else pen.fill();
  });
}
