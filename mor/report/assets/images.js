"use strict";
// Residual vectors of one image.
const images = { current: 0, order: [] };

function prepareImages() {
  const { vectors } = report;
  images.rows = new Map();
  for (let k = 0; k < vectors.rows; k++) {
    const name = value(vectors, "image", k);
    if (!images.rows.has(name)) images.rows.set(name, []);
    images.rows.get(name).push(k);
  }
  images.numbers = new Map(texts(report.images, "id").map((name, k) => [name, k]));
  images.order = [...images.numbers.keys()].filter((name) => images.rows.has(name));
  images.size = new Map();
  for (const name of images.order) {
    const { camera } = imageOf(name), sizes = images.size.get(camera) || [];
    images.size.set(camera, sizes);
    for (const k of images.rows.get(name)) {
      const size = Math.hypot(value(vectors, "vx", k), value(vectors, "vy", k));
      if (size >= 0) sizes.push(size);
    }
  }
  for (const [camera, sizes] of images.size) images.size.set(camera, sizes.sort((a, b) => a - b)[Math.floor(0.9 * (sizes.length - 1))] || 0);
}

// What there is of one image: rows of its vectors, camera, window, unit, columns by name.
function imageOf(name) {
  const { vectors, meta } = report, rows = images.rows.get(name), number = images.numbers.get(name);
  const camera = value(report.images, "camera", number), unit = typeof meta.image_unit === "string" ? meta.image_unit : meta.image_unit[name];
  return { rows, number, camera, area: meta.windows[camera], unit, column: (key) => rows.map((k) => vectors.columns[key].values[k]) };
}

// Enlargement of the vectors of a camera: large ones take a share of the width of the image.
function vectorScale(camera, share) {
  const { x } = report.meta.windows[camera], size = images.size.get(camera);
  return size > 0 ? roundLength((share * (x[1] - x[0])) / size) : 1;
}

// Vectors as separate lines, of flagged points or of all others.
function vectorLines(image, scale, wanted) {
  const [x, y, vx, vy] = ["x", "y", "vx", "vy"].map(image.column), data = { x: [], y: [] };
  image.rows.forEach((row, k) => {
    if (isGross(row) !== wanted) return;
    data.x.push(x[k], x[k] + scale * vx[k], null);
    data.y.push(y[k], y[k] + scale * vy[k], null);
  });
  return data;
}
function isGross(row) { return value(report.vectors, "flag", row).includes("gross"); }

function hullLine(image) {
  const [x, y] = ["x", "y"].map(image.column);
  const corners = hull(x.map((_, k) => [x[k], y[k]]).filter(([a, b]) => !Number.isNaN(a + b)));
  const closed = corners.length ? [...corners, corners[0]] : [];
  return { x: closed.map((p) => p[0]), y: closed.map((p) => p[1]), fill: "toself", fillcolor: "rgba(138,143,152,0.16)", line: { color: PALETTE.grey, dash: "dot", width: 1 } };
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
  const name = images.order[images.current], image = imageOf(name), { rows, number, area, unit } = image, { vectors } = report;
  const width = area.x[1] - area.x[0], height = area.y[1] - area.y[0], scale = vectorScale(image.camera, 0.05);
  const [x, y, vx, vy, w] = ["x", "y", "vx", "vy", "w"].map(image.column);
  const gross = rows.map(isGross);
  const hovered = rows.map((row, k) => `${value(vectors, "point", row)}<br>v ${shown(vx[k], { digits: 3 })}, ${shown(vy[k], { digits: 3 })} ${unit}<br>|w| ${shown(w[k], { fixed: 2 })}`);
  const data = [
    { type: "scatter", mode: "lines", name: say("covered"), ...hullLine(image), hoverinfo: "skip" },
    { type: "scatter", mode: "lines", name: `v × ${scale}`, meta: "vectors", ...vectorLines(image, scale, false), line: { color: PALETTE.blue, width: 1.8 }, hoverinfo: "skip" },
    { type: "scatter", mode: "lines", name: say("v, flagged"), ...vectorLines(image, scale, true), line: { color: PALETTE.red, width: 3 }, hoverinfo: "skip" },
    { type: "scatter", mode: "markers", name: say("image points"), x, y, marker: { size: gross.map((g) => (g ? 11 : 5)), symbol: gross.map((g) => (g ? "x" : "circle")), color: gross.map((g) => (g ? PALETTE.red : PALETTE.blue)) }, text: hovered, hovertemplate: "%{text}<extra></extra>" },
  ];
  const bar = roundLength((0.12 * width) / scale), level = area.down ? area.y[1] + 0.06 * height : area.y[0] - 0.06 * height;
  const note = document.getElementById("image-note");
  note.textContent = [
    say("{count:point|points}", { count: rows.length }), `${say("coverage")} ${shown(value(report.images, "coverage", number), { fixed: 0 })} %`,
    `${say("rms v")} ${shown(value(report.images, "rms", number), { digits: 3 })} ${unit}`, `${say("mean r")} ${shown(value(report.images, "mean_r", number), { fixed: 2 })}`,
  ].join(", ");
  const layout = {
    xaxis: { title: { text: `x [${unit}]` }, range: [area.x[0] - 0.04 * width, area.x[1] + 0.04 * width], constrain: "domain" },
    yaxis: { title: { text: `y [${unit}]` }, scaleanchor: "x", scaleratio: 1, constrain: "domain", range: area.down ? [area.y[1] + 0.1 * height, area.y[0] - 0.04 * height] : [area.y[0] - 0.1 * height, area.y[1] + 0.04 * height] },
    shapes: [
      { type: "rect", x0: area.x[0], x1: area.x[1], y0: area.y[0], y1: area.y[1], line: { color: PALETTE.grey, width: 1, dash: area.known ? "solid" : "dot" } },
      { type: "line", x0: area.x[0], x1: area.x[0] + scale * bar, y0: level, y1: level, line: { color: PALETTE.orange, width: 4 } },
    ],
    annotations: [{ x: area.x[0] + scale * bar, y: level, text: say("{length} in the vectors", { length: readable(bar, unit) }), showarrow: false, xanchor: "left", xshift: 6 }],
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
