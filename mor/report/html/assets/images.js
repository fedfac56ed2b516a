"use strict";
// Residual vectors of one image at a time.
const images = { current: 0, order: [] };

function prepareImages() {
  const { vectors } = report;
  images.rows = new Map();
  for (let k = 0; k < vectors.rows; k++) {
    const name = value(vectors, "image", k);
    if (!images.rows.has(name)) images.rows.set(name, []);
    images.rows.get(name).push(k);
  }
  images.order = texts(report.images, "id").filter((name) => images.rows.has(name));
  const sizes = Array.from({ length: vectors.rows }, (_, k) => Math.hypot(value(vectors, "vx", k), value(vectors, "vy", k))).filter((s) => s >= 0).sort((a, b) => a - b);
  images.size = sizes.length ? sizes[Math.floor(0.9 * (sizes.length - 1))] : 0;
}

function hull(points) {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (list) => {
    const chain = [];
    for (const p of list) {
      while (chain.length > 1) {
        const [a, b] = chain.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
        chain.pop();
      }
      chain.push(p);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

function imageChart() {
  const name = images.order[images.current], { vectors, meta } = report, rows = images.rows.get(name);
  const number = texts(report.images, "id").indexOf(name), camera = value(report.images, "camera", number), area = meta.windows[camera];
  const unit = typeof meta.image_unit === "string" ? meta.image_unit : meta.image_unit[name];
  const width = area.x[1] - area.x[0], height = area.y[1] - area.y[0];
  const scale = images.size > 0 ? roundLength((0.05 * width) / images.size) : 1;
  const get = (column) => rows.map((k) => vectors.columns[column].values[k]);
  const [x, y, vx, vy, w] = ["x", "y", "vx", "vy", "w"].map(get);
  const gross = rows.map((k) => value(vectors, "flag", k).includes("gross"));
  const line = (wanted) => {
    const data = { x: [], y: [] };
    rows.forEach((_, k) => { if (gross[k] === wanted) { data.x.push(x[k], x[k] + scale * vx[k], null); data.y.push(y[k], y[k] + scale * vy[k], null); } });
    return data;
  };
  const corners = hull(rows.map((_, k) => [x[k], y[k]]).filter(([a, b]) => !Number.isNaN(a + b)));
  const hovered = rows.map((row, k) => `${value(vectors, "point", row)}<br>v ${shown(vx[k], { digits: 3 })}, ${shown(vy[k], { digits: 3 })} ${unit}<br>|w| ${shown(w[k], { fixed: 2 })}`);
  const data = [
    { type: "scatter", mode: "lines", name: "covered", x: [...corners, corners[0]].map((p) => p && p[0]), y: [...corners, corners[0]].map((p) => p && p[1]), fill: "toself", fillcolor: "rgba(138,143,152,0.12)", line: { color: PALETTE.grey, dash: "dot", width: 1 }, hoverinfo: "skip" },
    { type: "scatter", mode: "lines", name: `v × ${scale}`, ...line(false), line: { color: PALETTE.blue, width: 1.8 }, hoverinfo: "skip" },
    { type: "scatter", mode: "lines", name: "v, flagged", ...line(true), line: { color: PALETTE.red, width: 3 }, hoverinfo: "skip" },
    { type: "scatter", mode: "markers", name: "image points", x, y, marker: { size: gross.map((g) => (g ? 11 : 5)), symbol: gross.map((g) => (g ? "x" : "circle")), color: gross.map((g) => (g ? PALETTE.red : PALETTE.blue)) }, text: hovered, hovertemplate: "%{text}<extra></extra>" },
  ];
  const bar = roundLength((0.12 * width) / scale), level = area.down ? area.y[1] + 0.06 * height : area.y[0] - 0.06 * height;
  const note = document.getElementById("image-note");
  note.textContent = `${rows.length} points, coverage ${shown(value(report.images, "coverage", number), { fixed: 0 })} %, rms v ${shown(value(report.images, "rms", number), { digits: 3 })} ${unit}, mean r ${shown(value(report.images, "mean_r", number), { fixed: 2 })}`;
  const layout = {
    xaxis: { title: { text: `x [${unit}]` }, range: [area.x[0] - 0.04 * width, area.x[1] + 0.04 * width] },
    yaxis: { title: { text: `y [${unit}]` }, scaleanchor: "x", scaleratio: 1, range: area.down ? [area.y[1] + 0.1 * height, area.y[0] - 0.04 * height] : [area.y[0] - 0.1 * height, area.y[1] + 0.04 * height] },
    shapes: [
      { type: "rect", x0: area.x[0], x1: area.x[1], y0: area.y[0], y1: area.y[1], line: { color: PALETTE.grey, width: 1, dash: area.known ? "solid" : "dot" } },
      { type: "line", x0: area.x[0], x1: area.x[0] + scale * bar, y0: level, y1: level, line: { color: PALETTE.orange, width: 4 } },
    ],
    annotations: [{ x: area.x[0] + scale * bar, y: level, text: `${readable(bar, unit)} in the vectors`, showarrow: false, xanchor: "left", xshift: 6 }],
    hovermode: "closest",
  };
  return { data, layout };
}

function showImage(number) {
  images.current = (number + images.order.length) % images.order.length;
  document.getElementById("image").value = images.order[images.current];
  return draw(document.getElementById("chart-image"), imageChart);
}

function imageControls() {
  const select = document.getElementById("image");
  select.replaceChildren(...images.order.map((name) => new Option(name)));
  select.addEventListener("change", () => showImage(select.selectedIndex));
  document.getElementById("previous").addEventListener("click", () => showImage(images.current - 1));
  document.getElementById("next").addEventListener("click", () => showImage(images.current + 1));
}
