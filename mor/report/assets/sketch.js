"use strict";
// The network as soon as its numbers are there, which is long before the chart library is: what a chart is going to draw, on a canvas in its place.
const SKETCH = { left: 60, right: 20, top: 34, bottom: 50 };

function sketch(element, { data, layout }) {
  const canvas = document.createElement("canvas"), dense = window.devicePixelRatio || 1;
  const width = element.clientWidth, height = element.clientHeight;
  canvas.className = "sketch";
  Object.assign(canvas, { width: width * dense, height: height * dense });
  element.append(canvas);
  const pen = canvas.getContext("2d");
  pen.scale(dense, dense);
  pen.font = '12px system-ui, "Segoe UI", "DejaVu Sans", sans-serif';
  const seen = data.filter((trace) => trace.mode && trace.meta !== "effects" && !trace.mode.includes("text"));
  const flat = layout.scene ? inPerspective(seen, layout.scene) : seen;
  const frame = framed(flat, layout, width, height);
  if (!layout.scene) {
    sketchAxes(pen, frame, layout);
    pen.rect(SKETCH.left, SKETCH.top, width - SKETCH.left - SKETCH.right, frame.bottom - SKETCH.top);
    pen.clip();
  }
  for (const trace of flat) (trace.mode === "lines" ? sketchLines : sketchMarkers)(pen, frame, trace);
}

// One scale for both axes, the middle of the data in the middle of the frame.
function framed(traces, layout, width, height) {
  const frame = { width, height };
  for (const name of ["x", "y"]) {
    let low = Infinity, high = -Infinity;
    for (const trace of traces) for (const v of trace[name]) if (v !== null && !Number.isNaN(v)) { if (v < low) low = v; if (v > high) high = v; }
    const range = layout[`${name}axis`]?.range;
    if (range) { low = Math.min(...range); high = Math.max(...range); }
    frame[name] = low <= high ? { middle: (low + high) / 2, size: high - low } : { middle: 0, size: 1 };
  }
  const bottom = layout.margin?.b || SKETCH.bottom, inner = [width - SKETCH.left - SKETCH.right, height - SKETCH.top - bottom];
  frame.bottom = height - bottom;
  frame.pixel = Math.max(frame.x.size / inner[0], frame.y.size / inner[1]) * 1.06 || 2 / inner[0]; // one point alone stands between −1 and 1
  frame.sign = { x: reversedAxis(layout.xaxis) ? -1 : 1, y: reversedAxis(layout.yaxis) ? 1 : -1 };
  frame.centre = { x: SKETCH.left + inner[0] / 2, y: SKETCH.top + inner[1] / 2 };
  frame.at = (name, v) => frame.centre[name] + (frame.sign[name] * (v - frame[name].middle)) / frame.pixel;
  return frame;
}
function reversedAxis(axis) { return Boolean(axis && (axis.range ? axis.range[0] > axis.range[1] : axis.autorange === "reversed")); }

function sketchAxes(pen, frame, layout) {
  const step = roundLength(90 * frame.pixel), places = Math.min(20, Math.max(0, -Math.floor(Math.log10(step))));
  const [left, right, top, bottom] = [SKETCH.left, frame.width - SKETCH.right, SKETCH.top, frame.bottom];
  pen.strokeStyle = css("--grid");
  pen.fillStyle = css("--ink");
  const ticks = (name, from, to) => {
    const half = (Math.abs(to - from) / 2) * frame.pixel, first = Math.ceil((frame[name].middle - half) / step), last = Math.floor((frame[name].middle + half) / step);
    return Array.from({ length: Math.max(0, last - first + 1) }, (_, k) => [(first + k) * step, frame.at(name, (first + k) * step)]);
  };
  pen.textAlign = "center";
  for (const [v, x] of ticks("x", left, right)) { line(pen, x, top, x, bottom); pen.fillText(minus(v.toFixed(places)), x, bottom + 16); }
  pen.fillText(layout.xaxis.title.text, (left + right) / 2, bottom + 38);
  pen.textAlign = "right";
  for (const [v, y] of ticks("y", bottom, top)) { line(pen, left, y, right, y); pen.fillText(minus(v.toFixed(places)), left - 4, y + 4); }
  pen.textAlign = "left";
  pen.fillText(layout.yaxis.title.text, left, top - 8);
}
function line(pen, x0, y0, x1, y1) { pen.beginPath(); pen.moveTo(x0, y0); pen.lineTo(x1, y1); pen.stroke(); }

function sketchLines(pen, frame, { x, y, line: { color, width } }) {
  pen.strokeStyle = color;
  pen.lineWidth = width || 1;
  pen.beginPath();
  for (let k = 0, lifted = true; k < x.length; k++) {
    if (x[k] === null || y[k] === null || Number.isNaN(x[k]) || Number.isNaN(y[k])) { lifted = true; continue; }
    pen[lifted ? "moveTo" : "lineTo"](frame.at("x", x[k]), frame.at("y", y[k]));
    lifted = false;
  }
  pen.stroke();
  pen.lineWidth = 1;
}

function sketchMarkers(pen, frame, { x, y, marker }) {
  const half = marker.size / 2, { color, cmin, cmax, colorscale, symbol } = marker, many = Array.isArray(color);
  pen.fillStyle = color;
  for (let k = 0; k < x.length; k++) {
    if (x[k] === null || y[k] === null || Number.isNaN(x[k])) continue;
    if (many) pen.fillStyle = color[k] === null ? PALETTE.grey : shade(colorscale, (color[k] - cmin) / (cmax - cmin || 1));
    const h = frame.at("x", x[k]), v = frame.at("y", y[k]);
    pen.beginPath();
    if (symbol) { pen.moveTo(h, v - half); pen.lineTo(h + half, v + half); pen.lineTo(h - half, v + half); } else pen.arc(h, v, half, 0, 2 * Math.PI);
    pen.fill();
  }
}

// The colour of a sequence at a share of its range.
function shade(sequence, share) {
  const at = Math.min(1, Math.max(0, share)), next = Math.max(1, sequence.findIndex(([to]) => to >= at));
  const [[from, before], [to, after]] = [sequence[next - 1], sequence[next]], part = (at - from) / (to - from);
  const channel = (text, k) => parseInt(text.slice(1 + 2 * k, 3 + 2 * k), 16);
  return `rgb(${[0, 1, 2].map((k) => Math.round(channel(before, k) + part * (channel(after, k) - channel(before, k)))).join(",")})`;
}

// As the camera of a scene sees it, which stands upright: the box of the axes has the lengths of the aspect ratio about its middle.
function inPerspective(traces, { xaxis, yaxis, zaxis, aspectratio, camera: { eye, center } }) {
  const axes = [[xaxis, aspectratio.x, "x"], [yaxis, aspectratio.y, "y"], [zaxis, aspectratio.z, "z"]];
  const away = axes.map(([, , name]) => center[name] - eye[name]), far = Math.hypot(...away), level = Math.hypot(away[0], away[1]);
  const forward = away.map((v) => v / far), right = [forward[1], -forward[0], 0].map((v) => (v * far) / level);
  const up = [right[1] * forward[2], -right[0] * forward[2], right[0] * forward[1] - right[1] * forward[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  return traces.map((trace) => {
    const flat = { ...trace, x: [], y: [] };
    for (let k = 0; k < trace.x.length; k++) {
      const from = axes.map(([{ range: [low, high] }, size, name]) => (trace[name][k] === null || (trace[name][k] - low) * (trace[name][k] - high) > 0 ? NaN : size * ((trace[name][k] - low) / (high - low) - 0.5) - eye[name]));
      flat.x.push(dot(from, right) / dot(from, forward));
      flat.y.push(dot(from, up) / dot(from, forward));
    }
    return flat;
  });
}
