"use strict";
// In the view of the network: names that do not overlap and follow the zoom.
const MOST_NAMES = 3000, NAME_SIZE = 10.5, LINE = 12, NO_LABELS = { x: [null], y: [null], text: [""] };

// The trace of names: as placed for the picture that is printed; on the screen they are placed anew.
function labelTrace() { return { mode: "text", name: "names", meta: "names", ...(network.labels || NO_LABELS), textfont: { size: NAME_SIZE, color: css("--ink") }, textposition: "middle center", hoverinfo: "skip", showlegend: false, cliponaxis: true }; }

// Names beside their points, stations and given points first; none where another name or a point is in the way.
function placedLabels(plot, x, y, larger = 1) {
  const { xaxis, yaxis } = plot._fullLayout, wide = xaxis._length, high = yaxis._length, placed = { x: [], y: [], text: [] };
  const candidates = [], named = new Set();
  const add = (table, rank) => {
    if (!has(table, "x")) return;
    for (let k = 0; k < Math.min(table.rows, 40000); k++) {
      if (named.has(value(table, "id", k))) continue; // a station that has the name of the point it stands on
      const px = xaxis.c2p(table.columns[x].values[k]), py = yaxis.c2p(table.columns[y].values[k]);
      if (px >= 0 && px <= wide && py >= 0 && py <= high) candidates.push({ px, py, rank: rank(k), name: value(table, "id", k) });
    }
    texts(table, "id").forEach((name) => named.add(name));
  };
  add(report.points, (k) => (has(report.points, "given") && value(report.points, "given", k) ? 0 : 2));
  add(report.stations, () => 1);
  add(report.images, () => 3);
  if (candidates.length > MOST_NAMES) return placed;
  const measured = document.createElement("canvas").getContext("2d");
  measured.font = `${NAME_SIZE}px ${plot._fullLayout.font.family}`;
  const taken = new Grid(), marks = candidates.map(({ px, py }) => [px - 4, py - 4, px + 4, py + 4]);
  [...marks, ...written(plot)].forEach((box) => taken.add(box));
  for (const one of candidates.sort((a, b) => a.rank - b.rank)) {
    const half = (larger * (measured.measureText(one.name).width + 2)) / 2;
    for (const [dx, dy] of [[half + 7, -8], [half + 7, 8], [-half - 7, -8], [-half - 7, 8], [0, -13], [0, 13]]) {
      const cx = one.px + dx, cy = one.py + larger * dy, box = [cx - half, cy - (larger * LINE) / 2, cx + half, cy + (larger * LINE) / 2];
      if (box[0] < 0 || box[1] < 0 || box[2] > wide || box[3] > high || taken.meets(box)) continue;
      taken.add(box);
      placed.x.push(xaxis.p2c(cx)); placed.y.push(yaxis.p2c(cy)); placed.text.push(one.name);
      break;
    }
  }
  return placed;
}

// Boxes of the scale bar and its words, in pixels of the drawing.
function written(plot) {
  const area = plot.querySelector(".nsewdrag")?.getBoundingClientRect();
  return area ? Array.from(plot.querySelectorAll(".annotation-text-g, .shapelayer path"), (one) => one.getBoundingClientRect()).map(({ left, top, right, bottom }) => [left - area.left - 3, top - area.top - 3, right - area.left + 3, bottom - area.top + 3]) : [];
}

// Boxes in cells of 64 pixels, so that few are looked at.
class Grid {
  constructor() { this.cells = new Map(); }
  *keys([x0, y0, x1, y1]) { for (let i = Math.floor(x0 / 64); i <= Math.floor(x1 / 64); i++) for (let j = Math.floor(y0 / 64); j <= Math.floor(y1 / 64); j++) yield `${i} ${j}`; }
  add(box) { for (const key of this.keys(box)) { if (!this.cells.has(key)) this.cells.set(key, []); this.cells.get(key).push(box); } }
  meets(box) {
    for (const key of this.keys(box)) for (const [x0, y0, x1, y1] of this.cells.get(key) || []) if (box[0] < x1 && x0 < box[2] && box[1] < y1 && y0 < box[3]) return true;
    return false;
  }
}

function followZoom(plot) {
  const { axes } = report.meta;
  const renew = () => {
    const [x, y] = PLANES[document.getElementById("plane").value] || [axes.right, axes.up], number = plot.data.findIndex((trace) => trace.meta === "names");
    if (number < 0) return;
    const placed = placedLabels(plot, x, y), { x: xs, y: ys, text } = placed.text.length ? placed : NO_LABELS;
    Plotly.restyle(plot, { x: [xs], y: [ys], text: [text] }, [number]);
  };
  if (!plot.dataset.follows) {
    plot.dataset.follows = "1";
    plot.on("plotly_relayout", renew);
  }
  const [x, y] = PLANES[document.getElementById("plane").value] || [axes.right, axes.up];
  const printed = placedLabels(plot, x, y, Math.max(1, plot.clientWidth / 950));
  network.labels = printed.text.length ? printed : null;
  renew();
}
