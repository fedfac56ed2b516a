"use strict";
// What is drawn over the network in either view: sights by kind, scale bars, given points, relative ellipses, external reliability.
const SIGHTS = [["direction", "directions", "#8a8f98", "solid", 1], ["distance", "distances", "#009e73", "dash", 1], ["levelling", "levelling lines", "#d55e00", "dot", 1], ["vector", "vectors between points", "#cc79a7", "dashdot", 1], ["scale", "scale bars", "#0072b2", "solid", 5]];
const MOST_SHOWN_SIGHTS = 400;

// Coordinates of a place by its number: points first, then stations.
function placeOf(number, key) {
  const own = number < report.points.rows;
  return (own ? report.points : report.stations).columns[key].values[own ? number : number - report.points.rows];
}

// A trace from lists of coordinates, one list for each key; the third is the height of a view in space.
function along(keys, lists) { return Object.fromEntries(keys.map((_, k) => ["xyz"[k], lists[k]])); }

// Lines of each kind; a click in the legend shows or hides them.
function sightTraces(keys) {
  const { sights } = report;
  if (!sights || !sights.rows) return [];
  return SIGHTS.map(([kind, name, color, dash, width]) => {
    const lists = keys.map(() => []);
    for (let k = 0; k < sights.rows; k++) {
      if (value(sights, "kind", k) !== kind) continue;
      const [a, b] = [sights.columns.a.values[k], sights.columns.b.values[k]];
      keys.forEach((key, n) => lists[n].push(placeOf(a, key), placeOf(b, key), null));
    }
    return { mode: "lines", name: say(name), meta: `sights ${kind}`, ...along(keys, lists), line: { color, dash, width }, hoverinfo: "skip", visible: kind === "scale" || sights.rows <= MOST_SHOWN_SIGHTS ? true : "legendonly" };
  }).filter((trace) => trace.x.length);
}

// Paths of instruments: knots one after the other, a line for each stretch.
function pathTraces(keys) {
  const { knots } = report, lists = keys.map(() => []);
  if (!has(knots, "x")) return [];
  const stretchOf = (k) => `${value(knots, "trajectory", k)} ${value(knots, "stretch", k)}`;
  for (let k = 0; k < knots.rows; k++) {
    if (k && stretchOf(k) !== stretchOf(k - 1)) lists.forEach((list) => list.push(null));
    keys.forEach((key, n) => lists[n].push(knots.columns[key].values[k]));
  }
  return [{ mode: "lines", name: say("trajectories"), meta: "paths", ...along(keys, lists), line: { color: PALETTE.orange, width: keys.length === 3 ? 4 : 2 }, hoverinfo: "skip" }];
}

function givenTraces(keys) {
  const { points } = report, space = keys.length === 3;
  const kinds = [["control", "control points", space ? "diamond-open" : "triangle-up-open"], ["check", "check points", "square-open"]];
  if (!has(points, "given")) return [];
  return kinds.map(([kind, name, symbol]) => {
    const rows = network.shown.filter((k) => value(points, "given", k) === kind);
    const lists = keys.map((key) => rows.map((k) => points.columns[key].values[k]));
    return { mode: "markers", name: say(name), meta: kind, ...along(keys, lists), marker: { symbol, size: space ? 7 : 14, color: css("--ink"), line: { width: 1.6 } }, hoverinfo: "skip" };
  }).filter((trace) => trace.x.length);
}

// Relative ellipses stand in the middle of their pair, in plan, enlarged as the others are.
function relativeTraces(x, y) {
  const { relative } = report, line = { x: [], y: [] };
  if (!relative || !relative.rows || network.confidence === "0" || x === "z" || y === "z") return [];
  const factor = network.scale * FACTORS[2][network.confidence], axis = { x: "dx", y: "dy" }, across = { x: ["dy", -1], y: ["dx", 1] };
  for (let k = 0; k < relative.rows; k++) {
    const of = (name) => relative.columns[name].values[k], one = of("one"), other = of("other");
    for (let step = 0; step <= 24; step++) {
      const u = of("a") * Math.cos((step * Math.PI) / 12), v = of("b") * Math.sin((step * Math.PI) / 12);
      for (const [to, key] of [["x", x], ["y", y]]) line[to].push((placeOf(one, key) + placeOf(other, key)) / 2 + factor * (u * of(axis[key]) + v * across[key][1] * of(across[key][0])));
    }
    line.x.push(null); line.y.push(null);
  }
  return [{ mode: "lines", name: say("relative ellipses × {scale}", { scale: network.scale }), meta: "relative", ...line, line: { color: PALETTE.green, width: 1.2 }, hoverinfo: "skip" }];
}

// External reliability: where an error that just stays unseen would move each point; off until the legend is clicked.
function effectTraces(keys) {
  const { effects } = report, lists = keys.map(() => []);
  if (!effects || !effects.rows) return [];
  for (let k = 0; k < effects.rows; k++) {
    const point = effects.columns.point.values[k];
    keys.forEach((key, n) => { const here = placeOf(point, key); lists[n].push(here, here + report.meta.effects_scale * effects.columns[`d${key}`].values[k], null); });
  }
  return [{ mode: "lines+markers", name: say("external reliability × {scale}", { scale: report.meta.effects_scale }), meta: "effects", ...along(keys, lists), line: { color: PALETTE.red, width: 2 }, marker: { color: PALETTE.red, size: keys.length === 3 ? 2 : lists[0].map((_, k) => (k % 3 === 1 ? 7 : 0.1)), symbol: "circle" }, hoverinfo: "skip", visible: "legendonly" }];
}
