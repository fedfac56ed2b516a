"use strict";
// Overlap of the images, and rays of each point, in the view in which the points are widest.
const RAY_LOOKS = [[PALETTE.red, "x", 8], [PALETTE.red, "cross", 8], [PALETTE.orange, "triangle-up", 8], [PALETTE.green, "circle", 5], [PALETTE.blue, "circle", 5], [PALETTE.grey, "circle", 5]];

function mapLayout() {
  const { axes, length } = report.meta, { right, up } = report.overlap;
  const reversed = (name) => (name === axes.right && axes.right_reversed) || (name === axes.up && axes.up_reversed);
  const axis = (name) => ({ title: { text: `${name.toUpperCase()} [${length}]` }, exponentformat: "none", nticks: narrow() ? 4 : 6, constrain: narrow() ? "range" : "domain", ...(reversed(name) ? { autorange: "reversed" } : {}) });
  return { xaxis: axis(right), yaxis: { ...axis(up), scaleanchor: "x", scaleratio: 1 }, margin: { l: 84, r: 20, t: 34, b: 50 }, hovermode: "closest" }; // room for large coordinates on a phone
}

function overlapChart() {
  const { first, step, count } = report.overlap, most = Math.max(...count.flat());
  const data = [{ type: "heatmap", meta: "overlap", x0: first[0], dx: step, y0: first[1], dy: step, z: count.map((row) => row.map((n) => n || null)), colorscale: SEQUENCES[isDark() ? "dark" : "light"], zmin: 1, hoverongaps: false, colorbar: { title: { text: say("images"), side: "right" }, thickness: 14, len: 0.8, tick0: 0, dtick: Math.ceil(most / 8) }, hovertemplate: `%{z} ${say("images")}<extra></extra>` }];
  return { data, layout: mapLayout() };
}

function raysChart() {
  const { points } = report, { right, up } = report.overlap, rays = points.columns.rays.values;
  const data = report.overlap.classes.map(([low, high], k) => {
    const [color, symbol, size] = RAY_LOOKS[k], within = (n) => n >= low && (high === null || n <= high);
    const rows = network.shown.filter((row) => within(rays[row])), column = (name) => rows.map((row) => points.columns[name].values[row]);
    const name = high === null ? `\u2265 ${low}` : low === high ? String(low) : `${low}\u2013${high}`;
    const count = rays.reduce((sum, n) => sum + within(n), 0);
    return { type: points.rows > 5000 ? "scattergl" : "scatter", mode: "markers", meta: "rays", name: `${name} (${count})`, x: column(right), y: column(up), text: rows.map((row) => `${value(points, "id", row)}: ${rays[row]}`), marker: { color, symbol, size: points.rows > 5000 ? size / 2 : size }, hovertemplate: "%{text}<extra></extra>" };
  }).filter((trace) => trace.x.length);
  return { data, layout: { ...mapLayout(), showlegend: true, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, title: { text: `${say("rays")} ` } } } };
}

async function drawOverlap() {
  const map = document.getElementById("chart-overlap"), rays = document.getElementById("chart-rays");
  if (map) { await draw(map, overlapChart); await pause(); await draw(rays, raysChart); }
}
