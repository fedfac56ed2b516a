"use strict";
// The network in space and in plan: points, frames, ellipsoids, and the rays of what was picked.
const MOST_POINTS = 40000, MOST_ELLIPSOIDS = 400, MOST_ELLIPSES = 2000;
// As in a picture of mor plot: share of the extent that the median ellipse is drawn with; how many times as large one may be to be drawn.
const TYPICAL = 0.012, TOO_LARGE = 8;
const network = { picked: null, colour: "", confidence: "1", scale: 1 };
const FACTORS = { 2: { 1: 1, 95: 2.4477 }, 3: { 1: 1, 95: 2.7955 } };

function place(table, row) { return ["x", "y", "z"].map((name) => table.columns[name].values[row]); }
function known(name) {
  for (const [kind, table] of [["point", report.points], ["image", report.images], ["station", report.stations]]) {
    const row = has(table, "id") ? texts(table, "id").indexOf(name) : -1;
    if (row >= 0) return { kind, row };
  }
  return null;
}

function prepareNetwork() {
  const { points, images, stations, rays } = report;
  network.shown = Array.from({ length: points.rows }, (_, k) => k);
  if (points.rows > MOST_POINTS) {
    const step = Math.ceil(points.rows / MOST_POINTS);
    network.shown = network.shown.filter((k) => k % step === 0);
  }
  network.ofPoint = new Map();
  network.ofFrame = new Map();
  const { frame, point } = rays.columns;
  for (let k = 0; k < rays.rows; k++) {
    const f = frame.values[k], p = point.values[k];
    if (!network.ofPoint.has(p)) network.ofPoint.set(p, []);
    network.ofPoint.get(p).push(f);
    if (!network.ofFrame.has(f)) network.ofFrame.set(f, []);
    network.ofFrame.get(f).push(p);
  }
  network.extent = extent([points, images, stations]);
  const axes = Array.from({ length: points.rows }, (_, k) => value(points, "ellipsoid_a", k)).filter((a) => a > 0).sort((a, b) => a - b);
  network.typical = axes.length ? axes[Math.floor((axes.length - 1) / 2)] : 0;
  network.scale = axes.length ? roundLength((TYPICAL * network.extent) / network.typical) : 1;
  network.colours = [
    ["", say("nothing"), ""], ["ellipsoid_a", say("longest semi-axis"), report.meta.length], ["mean_r", say("mean r"), "1"], ["smallest_r", say("smallest r"), "1"],
    ["largest_w", say("largest |w|"), "1"], ["angle", say("best intersection"), report.meta.meeting], ["rays", say("rays"), "1"],
  ].filter(([key]) => !key || has(points, key));
  network.colour = has(points, "ellipsoid_a") && axes.length ? "ellipsoid_a" : "";
  network.confidence = axes.length ? "1" : "0";
}

// The frame of the figures, where it is smaller than the network: least and largest coordinate.
function edges(name) { const { frame } = report.meta; return frame.length ? frame.map((edge) => edge["xyz".indexOf(name)]) : null; }

// Arrows at the edge to what stands outside, with names and distances.
function outsideTraces(x, y) {
  if (!edges(x)) return [];
  const middle = {}, half = {}, trace = { x: [], y: [], text: [], angle: [], position: [] }, named = new Set();
  for (const name of [x, y]) { const [low, high] = edges(name); middle[name] = (low + high) / 2; half[name] = (high - low) / 2; }
  const flat = 0.05 * Math.max(half[x], half[y]), turned = (name, v) => (reversed(name) ? -v : v);
  for (const table of [report.points, report.stations, report.images]) for (let k = 0; k < (has(table, x) ? table.rows : 0); k++) {
    const [dx, dy] = [x, y].map((name) => table.columns[name].values[k] - middle[name]);
    const far = Math.max(Math.abs(dx) / Math.max(half[x], flat), Math.abs(dy) / Math.max(half[y], flat));
    if (!(far > 1.000001) || named.has(value(table, "id", k))) continue;
    named.add(value(table, "id", k)); // a station may have the name of its point
    trace.x.push(middle[x] + dx / far); trace.y.push(middle[y] + dy / far);
    const away = Math.hypot(dx, dy) * (1 - 1 / far);
    trace.text.push(`${value(table, "id", k)}, ${shown(away, away < 100 ? { digits: 3 } : { fixed: 0 })} ${report.meta.length}`);
    trace.angle.push((Math.atan2(turned(x, dx), turned(y, dy)) * 180) / Math.PI);
    trace.position.push(`${turned(y, dy) > 0 ? "bottom" : "top"} ${turned(x, dx) > 0 ? "left" : "right"}`);
  }
  const count = trace.x.length, few = count <= 10;
  return count ? [{ mode: few ? "markers+text" : "markers", name: say("outside the figure ({count})", { count }), meta: "outside", x: trace.x, y: trace.y, text: trace.text, textposition: trace.position, textfont: { size: 10.5 }, marker: { symbol: "triangle-up", size: 12, angle: trace.angle, color: PALETTE.red }, hovertemplate: "%{text}<extra></extra>" }] : [];
}

function narrow() { return window.innerWidth <= 620; }
function reversed(name) { const { axes } = report.meta; return (name === axes.right && axes.right_reversed) || (name === axes.up && axes.up_reversed); }

function extent(tables) {
  return Math.max(...["x", "y", "z"].map((name) => span(tables, name))) || 1;
}

function span(tables, name) {
  const edge = edges(name);
  if (edge) return edge[1] - edge[0];
  let low = Infinity, high = -Infinity;
  for (const table of tables) for (const x of has(table, name) ? table.columns[name].values : []) { if (x < low) low = x; if (x > high) high = x; }
  return high > low ? high - low : 0;
}

// Covariance of a point from σ and correlations, and a lower triangular root of it.
function covariance(row) {
  const [sx, sy, sz, rxy, rxz, ryz] = ["sx", "sy", "sz", "rxy", "rxz", "ryz"].map((name) => value(report.points, name, row) || 0);
  return [[sx * sx, rxy * sx * sy, rxz * sx * sz], [rxy * sx * sy, sy * sy, ryz * sy * sz], [rxz * sx * sz, ryz * sy * sz, sz * sz]];
}
function root(matrix) {
  const n = matrix.length, L = matrix.map((line) => line.map(() => 0));
  for (let i = 0; i < n; i++) for (let j = 0; j <= i; j++) {
    let sum = matrix[i][j];
    for (let k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
    L[i][j] = i === j ? Math.sqrt(Math.max(sum, 0)) : L[j][j] > 0 ? sum / L[j][j] : 0;
  }
  return L;
}

function pointTrace(x, y, z) {
  const { points, meta } = report, rows = network.shown;
  const marker = { size: z ? 2.8 : 6, color: PALETTE.blue };
  if (network.colour) {
    const [, title, unit] = network.colours.find(([key]) => key === network.colour);
    const values = points.columns[network.colour].values;
    const sorted = rows.map((k) => values[k]).filter((v) => !Number.isNaN(v)).sort((a, b) => a - b);
    const at = (share) => sorted[Math.round(share * (sorted.length - 1))];
    const [said, factor] = finer(at(0.98), unit);
    Object.assign(marker, { color: rows.map((k) => (Number.isNaN(values[k]) ? null : factor * values[k])), colorscale: SEQUENCES[isDark() ? "dark" : "light"], cmin: factor * at(0.02), cmax: factor * at(0.98), showscale: true, colorbar: { title: { text: narrow() ? `[${said}]` : `${title} [${said}]`, side: "right" }, thickness: 14, ...(narrow() ? { orientation: "h", yref: "container", y: 0, yanchor: "bottom", len: 0.9 } : { len: 0.7 }) } });
  }
  const column = (name) => rows.map((k) => points.columns[name].values[k]);
  const trace = { mode: "markers", name: say("points"), meta: "points", marker, x: column(x), y: column(y), text: rows.map((k) => value(points, "id", k)), customdata: rows.map((k) => ["point", k]), hovertemplate: `%{text}<br>${x.toUpperCase()} %{x:.4f} ${meta.length}<br>${y.toUpperCase()} %{y:.4f} ${meta.length}<extra></extra>` };
  if (z) trace.z = column(z);
  return trace;
}

function frameTraces(x, y, z) {
  const looks = [["image", report.images, say("images"), "diamond", PALETTE.orange], ["station", report.stations, say("stations"), z ? "square" : "triangle-up", PALETTE.red]];
  return looks.filter(([, table]) => has(table, "x")).map(([kind, table, name, symbol, color]) => {
    const column = (key) => numbers(table, key);
    const trace = { mode: "markers", name, meta: `${kind}s`, marker: { symbol, color, size: (z ? 5 : kind === "station" ? 14 : 9) * (table.rows > 150 ? 0.5 : 1) }, x: column(x), y: column(y), text: texts(table, "id"), customdata: Array.from({ length: table.rows }, (_, k) => [kind, k]), hovertemplate: `%{text}<extra>${say(kind)}</extra>` };
    if (z) trace.z = column(z);
    return trace;
  });
}

function frameOf(number) {
  const images = report.images.rows;
  return number < images ? { kind: "image", table: report.images, row: number } : { kind: "station", table: report.stations, row: number - images };
}

// Rays of a scanned image start wherever the scanner was: the place of the table is that of its first line.
function isScanned(table, row) { return table === report.images && report.meta.scanned.includes(value(table, "id", row)); }

function rayTraces(keys) {
  const { picked } = network;
  if (!picked) return [];
  const coordinates = keys.map(() => []);
  const add = (from, to) => keys.forEach((key, k) => coordinates[k].push(from["xyz".indexOf(key)], to["xyz".indexOf(key)], null));
  let here;
  if (picked.kind === "point") {
    here = place(report.points, picked.row);
    for (const frame of network.ofPoint.get(picked.row) || []) { const { table, row } = frameOf(frame); if (!isScanned(table, row)) add(place(table, row), here); }
  } else {
    const table = picked.kind === "image" ? report.images : report.stations;
    here = place(table, picked.row);
    const number = picked.kind === "image" ? picked.row : report.images.rows + picked.row;
    if (!isScanned(table, picked.row)) for (const point of network.ofFrame.get(number) || []) add(here, place(report.points, point));
  }
  const axis = (list) => Object.fromEntries(list.map((data, k) => ["xyz"[k], data]));
  const lines = { mode: "lines", name: say("rays of the picked"), meta: "rays", line: { color: PALETTE.purple, width: keys.length === 3 ? 3 : 1.6 }, hoverinfo: "skip", ...axis(coordinates) };
  const ring = { mode: "markers", name: say("picked"), marker: { symbol: "circle-open", size: keys.length === 3 ? 10 : 15, color: PALETTE.purple, line: { width: 3, color: PALETTE.purple } }, hoverinfo: "skip", ...axis(keys.map((key) => [here["xyz".indexOf(key)]])) };
  return [lines, ring];
}

function tooLarge(row) { return value(report.points, "ellipsoid_a", row) > TOO_LARGE * network.typical; }

// Points whose ellipse would hide the others.
function outlierTraces(keys) {
  const rows = network.confidence === "0" ? [] : network.shown.filter(tooLarge);
  if (!rows.length) return [];
  const lists = keys.map((key) => rows.map((k) => report.points.columns[key].values[k]));
  return [{ mode: "markers", name: say("ellipse too large to draw ({count})", { count: rows.length }), meta: "outliers", ...along(keys, lists), marker: { symbol: "x", size: keys.length === 3 ? 6 : 12, color: PALETTE.red }, hoverinfo: "skip" }];
}

function withEllipses(most) {
  if (network.confidence === "0" || !has(report.points, "sx")) return [];
  const rows = network.shown.filter((k) => value(report.points, "ellipsoid_a", k) > 0 && !tooLarge(k));
  if (rows.length <= most) return rows;
  return rows.sort((a, b) => value(report.points, "ellipsoid_a", b) - value(report.points, "ellipsoid_a", a)).slice(0, most);
}

// All ellipsoids as one mesh: a coarse sphere, each time under the root of the covariance.
function ellipsoids() {
  const rows = withEllipses(MOST_ELLIPSOIDS);
  if (!rows.length) return [];
  const rings = 6, spokes = 10, sphere = [];
  for (let a = 0; a <= rings; a++) for (let b = 0; b < spokes; b++) {
    const t = (Math.PI * a) / rings, s = (2 * Math.PI * b) / spokes;
    sphere.push([Math.sin(t) * Math.cos(s), Math.sin(t) * Math.sin(s), Math.cos(t)]);
  }
  const mesh = { x: [], y: [], z: [], i: [], j: [], k: [] };
  const factor = network.scale * FACTORS[3][network.confidence];
  for (const row of rows) {
    const L = needle(root(covariance(row))), centre = place(report.points, row), first = mesh.x.length;
    for (const u of sphere) ["x", "y", "z"].forEach((name, n) => mesh[name].push(centre[n] + factor * (L[n][0] * u[0] + L[n][1] * u[1] + L[n][2] * u[2])));
    for (let a = 0; a < rings; a++) for (let b = 0; b < spokes; b++) {
      const p = first + a * spokes + b, q = first + a * spokes + ((b + 1) % spokes);
      mesh.i.push(p, q); mesh.j.push(q, q + spokes); mesh.k.push(p + spokes, p + spokes);
    }
  }
  return [scaleBarInSpace(), { type: "mesh3d", name: say("ellipsoids × {scale}", { scale: network.scale }), meta: "ellipsoids", ...mesh, color: PALETTE.grey, opacity: 0.35, flatshading: false, hoverinfo: "skip", showlegend: true }];
}

// Held coordinates give an ellipsoid no extent: it is drawn so thick that it can be seen.
function needle(L) {
  const largest = Math.max(...L.map((line, n) => Math.hypot(...line.slice(0, n + 1))));
  return L.map((line, n) => (line.some((x) => x !== 0) ? line : line.map((x, m) => (m === n ? 0.12 * largest : 0))));
}

// How long an enlarged semi-axis is drawn in space: a bar along X from the lower left corner.
function scaleBarInSpace() {
  const length = roundLength((0.08 * network.extent) / network.scale), [x, y, z] = ["x", "y", "z"].map(lowest);
  const words = say("{length} in the ellipsoids", { length: readable(length, report.meta.length) });
  return { mode: "lines", name: words, meta: "bar", x: [x, x + length * network.scale], y: [y, y], z: [z, z], line: { color: PALETTE.orange, width: 8 }, hoverinfo: "skip", showlegend: true };
}
function lowest(name) {
  if (edges(name)) return edges(name)[0];
  let low = Infinity;
  for (const table of [report.points, report.images, report.stations]) for (const v of has(table, name) ? table.columns[name].values : []) if (v < low) low = v;
  return low;
}

function ellipses(x, y) {
  const rows = withEllipses(MOST_ELLIPSES), a = "xyz".indexOf(x), b = "xyz".indexOf(y), line = { x: [], y: [] };
  const factor = network.scale * FACTORS[2][network.confidence];
  for (const row of rows) {
    const C = covariance(row), L = root([[C[a][a], C[a][b]], [C[b][a], C[b][b]]]), centre = place(report.points, row);
    for (let k = 0; k <= 24; k++) {
      const u = Math.cos((k * Math.PI) / 12), v = Math.sin((k * Math.PI) / 12);
      line.x.push(centre[a] + factor * L[0][0] * u);
      line.y.push(centre[b] + factor * (L[1][0] * u + L[1][1] * v));
    }
    line.x.push(null); line.y.push(null);
  }
  return rows.length ? [{ type: "scatter", mode: "lines", name: say("ellipses × {scale}", { scale: network.scale }), meta: "ellipses", ...line, line: { color: PALETTE.grey, width: 1.2 }, hoverinfo: "skip" }] : [];
}

function space() {
  const { axes, length } = report.meta;
  const [x, y] = [axes.right, axes.up];
  const keys = [x, y, "z"];
  const data = [...sightTraces(keys), ...pathTraces(keys), pointTrace(x, y, "z"), ...frameTraces(x, y, "z"), ...givenTraces(keys), ...outlierTraces(keys), ...effectTraces(keys), ...rayTraces(keys)].map((trace) => ({ type: "scatter3d", ...trace }));
  for (const shape of ellipsoids()) data.push({ type: "scatter3d", ...shape, x: shape[x], y: shape[y] });
  const box = boxOf(data), across = Math.min(2.4 / Math.hypot(box.x.size, box.y.size), 1.1 / box.z.size);
  // Short sides have few ticks, so that their numbers do not overlap.
  const ticks = (side) => Math.max(2, Math.round(((narrow() ? 4 : 8) * side.size) / Math.max(box.x.size, box.y.size, box.z.size)));
  const axis = (name, side, reversed) => ({ title: { text: `${name.toUpperCase()} [${length}]` }, exponentformat: "none", nticks: ticks(side), range: reversed ? [side.high, side.low] : [side.low, side.high] });
  const aspectratio = { x: across * box.x.size, y: across * box.y.size, z: across * box.z.size };
  // The scene fits into its box: the narrower that is, the further away stands the camera.
  const chart = document.getElementById("chart-space"), side = window.innerWidth > 1000 ? 190 : 0, back = (narrow() ? 1.2 : 1) * Math.max(1, (1.5 * chart.clientHeight) / (chart.clientWidth - side - (narrow() ? 0 : 110)));
  const scene = { aspectmode: "manual", aspectratio, xaxis: axis(x, box.x, axes.right_reversed), yaxis: axis(y, box.y, axes.up_reversed), zaxis: axis("z", box.z), camera: { eye: { x: 1.1 * back, y: -1.75 * back, z: back }, center: { x: 0, y: 0, z: -0.1 } } };
  return { data, layout: { scene, margin: { l: 0, r: side, t: 30, b: 0 }, showlegend: !narrow(), uirevision: "space" } };
}

// What is drawn lies in this box, one scale for its sides. Flat and straight networks get some room on either side.
function boxOf(data) {
  const box = {};
  for (const name of ["x", "y", "z"]) {
    let low = Infinity, high = -Infinity;
    for (const trace of data.filter((one) => one.meta !== "effects")) for (const v of trace[name]) if (v !== null && !Number.isNaN(v)) { if (v < low) low = v; if (v > high) high = v; }
    const edge = edges(name);
    box[name] = edge ? { low: edge[0], high: edge[1] } : { low, high };
  }
  const largest = Math.max(...Object.values(box).map(({ low, high }) => high - low)) || 1;
  for (const side of Object.values(box)) {
    const middle = (side.low + side.high) / 2, half = Math.max(0.53 * (side.high - side.low), 0.07 * largest);
    Object.assign(side, { low: middle - half, high: middle + half, size: (2 * half) / largest });
  }
  return box;
}

const PLANES = { plan: null, front: ["x", "z"], side: ["y", "z"] };
function plan() {
  const { axes, length } = report.meta;
  const chosen = document.getElementById("plane").value, [x, y] = PLANES[chosen] || [axes.right, axes.up];
  const data = [...sightTraces([x, y]), ...pathTraces([x, y]), ...ellipses(x, y), ...relativeTraces(x, y), ...effectTraces([x, y]), ...rayTraces([x, y]), ...frameTraces(x, y), pointTrace(x, y), ...givenTraces([x, y]), ...outlierTraces([x, y]), ...outsideTraces(x, y), labelTrace()].map((trace) => ({ type: report.points.rows > 5000 ? "scattergl" : "scatter", ...trace }));
  const room = 0.06 * Math.max(...[x, y].map((name) => (edges(name) ? edges(name)[1] - edges(name)[0] : 0)));
  const range = (name) => { const ends = [edges(name)[0] - room, edges(name)[1] + room]; return reversed(name) ? ends.reverse() : ends; };
  const axis = (name) => ({ title: { text: `${name.toUpperCase()} [${length}]` }, exponentformat: "none", ...(edges(name) ? { range: range(name) } : reversed(name) ? { autorange: "reversed" } : {}) });
  return { data, layout: { xaxis: axis(x), yaxis: { ...axis(y), scaleanchor: "x", scaleratio: 1 }, ...scaleBar(), margin: { l: 60, r: 20, t: 34, b: narrow() ? 130 : 84 }, hovermode: "closest", uirevision: chosen } };
}

// How long an enlarged semi-axis is drawn: a bar of a round length.
function scaleBar() {
  if (network.confidence === "0" || !withEllipses(1).length) return {};
  const length = roundLength((0.08 * network.extent) / network.scale);
  const words = say("{length} in the ellipses", { length: readable(length, report.meta.length) });
  const chosen = document.getElementById("plane").value, [x] = PLANES[chosen] || [report.meta.axes.right], low = lowest(x), end = low + length * network.scale;
  const bar = { type: "line", xref: "x", x0: low, x1: end, yref: "paper", ysizemode: "pixel", yanchor: 0, y0: -66, y1: -66 };
  return { shapes: [{ ...bar, line: { color: PALETTE.orange, width: 4 } }], annotations: [{ xref: "x", yref: "paper", x: reversed(x) ? low : end, y: 0, yshift: -66, text: words, showarrow: false, xanchor: "left", yanchor: "middle", xshift: 6, font: { color: css("--ink") } }] };
}

function pick(found) {
  network.picked = found;
  document.getElementById("picked").textContent = found ? words(found) : say("Click a point, an image or a station: its rays and numbers appear here.");
  document.getElementById("picked").classList.toggle("some", Boolean(found));
  document.documentElement.dataset.picked = found ? `${found.kind} ${found.row}` : "";
  drawNetwork();
}

function words({ kind, row }) {
  const { meta } = report, table = { point: report.points, image: report.images, station: report.stations }[kind];
  const title = say(kind), parts = [`${title[0].toUpperCase()}${title.slice(1)} ${value(table, "id", row)}`];
  for (const name of ["x", "y", "z"]) {
    const sigma = value(table, `s${name}`, row);
    parts.push(`${name.toUpperCase()} ${shown(value(table, name, row), { fixed: 4 })} ${meta.length}${sigma > 0 ? ` ± ${readable(sigma, meta.length)}` : ""}`);
  }
  if (kind === "point") {
    parts.push(`${say("ellipsoid")} ${["a", "b", "c"].map((n) => semiAxis(row, n)).join(" / ")}`);
    parts.push(say("{rays:ray|rays}, {others:other row|other rows}", { rays: value(table, "rays", row), others: value(table, "others", row) }));
    if (has(table, "angle")) parts.push(`${say("best intersection")} ${shown(value(table, "angle", row), { digits: 3 })} ${meta.meeting}`);
    if (has(table, "mean_r")) parts.push(`${say("mean r")} ${shown(value(table, "mean_r", row), { fixed: 2 })}, ${say("largest |w|")} ${shown(value(table, "largest_w", row), { fixed: 2 })}`);
  } else if (kind === "image") parts.push(say("{count:point|points}", { count: value(table, "points", row) }));
  return `${parts.join(" · ")} (${say("σ in the datum: {datum}", { datum: meta.datum })})`;
}

// Length and direction of a semi-axis: azimuth and elevation, where it has a length and the page has its direction.
function semiAxis(row, axis) {
  const { points, meta } = report, azimuth = value(points, `ellipsoid_azimuth_${axis}`, row);
  const length = readable(value(points, `ellipsoid_${axis}`, row) || 0, meta.length);
  return azimuth >= 0 ? `${length} (${shown(azimuth, { fixed: tenths(meta.angle) })}, ${shown(value(points, `ellipsoid_elevation_${axis}`, row), { fixed: tenths(meta.angle) })} ${meta.angle})` : length;
}

// In space a click is said again with every frame while the button is down: it counts once, and is drawn afterwards.
function clicked(event) {
  const point = event.points.find((one) => one.customdata);
  if (!point) return;
  const [kind, row] = point.customdata, { picked } = network;
  if (picked && picked.kind === kind && picked.row === row) return;
  network.picked = { kind, row };
  setTimeout(() => pick(network.picked), 0);
}

async function drawNetwork() {
  await drawSpace();
  await drawPlane();
}

function sketchNetwork() {
  sketch(document.getElementById("chart-space"), space());
  sketch(document.getElementById("chart-plan"), plan());
}

function drawSpace() { return draw(document.getElementById("chart-space"), space, clicked); }

async function drawPlane() {
  await draw(document.getElementById("chart-plan"), plan, clicked);
  followZoom(document.querySelector("#chart-plan .plot"));
  const notes = [say("Ellipsoids and ellipses are enlarged {scale} times.", { scale: network.scale })];
  const all = report.points.rows;
  if (network.shown.length < all) notes.push(say("{count} of {all} points are drawn; the table has all.", { count: network.shown.length, all }));
  if (withEllipses(MOST_ELLIPSOIDS).length === MOST_ELLIPSOIDS) notes.push(say("In space the {count} largest ellipsoids are drawn.", { count: MOST_ELLIPSOIDS }));
  document.getElementById("network-note").textContent = notes.join(" ");
}

// The view in which the points are widest: a facade, a plumb line, and a network of which the heights alone are determined, are seen in elevation.
function bestPlane() {
  const { points, images, stations } = report;
  const across = ["x", "y"].some((name) => span([points, images, stations], name) > 0);
  const level = has(points, "sz") && ["sx", "sy"].every((name) => !numbers(points, name).some((s) => s > 0)) && numbers(points, "sz").some((s) => s > 0);
  const all = [points, images, stations], [x, y, z] = ["x", "y", "z"].map((name) => span([points], name));
  const upright = (!across && span(all, "z") > 0) || z > Math.min(x, y);
  if (!upright && !level) return "plan";
  return y > x ? "side" : "front";
}

function networkControls() {
  document.getElementById("plane").value = bestPlane();
  const options = (id, list, chosen) => {
    document.getElementById(id).replaceChildren(...list.map(([key, title]) => new Option(title, key, false, String(key) === String(chosen))));
  };
  options("colour", network.colours, network.colour);
  options("enlarged", [0.01, 0.1, 0.2, 0.5, 1, 2, 5, 10, 100].map((f) => { const s = Number((f * network.scale).toPrecision(3)); return [s, `${s} ×`]; }), network.scale);
  document.getElementById("confidence").value = network.confidence;
  for (const [id, key, kind] of [["colour", "colour", String], ["confidence", "confidence", String], ["enlarged", "scale", Number]]) {
    document.getElementById(id).addEventListener("change", (event) => { network[key] = kind(event.target.value); drawNetwork(); });
  }
  document.getElementById("plane").addEventListener("change", drawNetwork);
  const input = document.getElementById("pick");
  input.addEventListener("change", () => { const found = known(input.value.trim()); if (found) pick(found); });
  document.getElementById("clear").addEventListener("click", () => { input.value = ""; pick(null); });
  const names = [report.images, report.stations, report.points].filter((table) => has(table, "id")).flatMap((table) => texts(table, "id"));
  document.getElementById("names").replaceChildren(...names.slice(0, 2000).map((name) => new Option(name)));
}
