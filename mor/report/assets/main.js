"use strict";
// Puts the page together, what is seen first first.
// Decimals with which nearly every σ of some columns has two digits: one number for a column, and for its coordinates.
function placesBySigma(table, keys, otherwise) {
  const sigmas = keys.filter((key) => has(table, key)).flatMap((key) => Array.from(table.columns[key].values)).filter((s) => s > 0).sort((a, b) => a - b);
  return sigmas.length ? Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(sigmas[Math.floor(0.1 * sigmas.length)])))) : otherwise;
}

// Decimals of directions of semi-axes, which nobody knows to more than a tenth of a degree.
function tenths(angle) { return { rad: 3, mrad: 0, mgon: 0 }[angle] ?? 1; }

function tableColumns() {
  const { length, angle, meeting, image_unit: unit } = report.meta;
  const digits = { m: 4, mm: 3, cm: 3, dm: 4, um: 1, km: 7, ft: 4, "us-ft": 4, in: 3 }[length];
  const angles = { gon: 4, deg: 4, rad: 6, mrad: 3, mgon: 1 }[angle];
  const text = (key, title, words = false) => ({ key, title, text: true, words });
  const fixed = (key, title, places, u = "1") => ({ key, title, unit: u, fixed: places });
  const short = (key, title, u = "", size = false) => ({ key, title, unit: u, digits: 3, size });
  const xyz = ["x", "y", "z"], sxyz = ["sx", "sy", "sz"], turns = ["omega", "phi", "kappa"];
  const placed = (table) => { const places = placesBySigma(table, sxyz, digits); return [...xyz.map((key) => fixed(key, key.toUpperCase(), places, length)), ...sxyz.map((key) => fixed(key, `σ${key[1].toUpperCase()}`, places, length))]; };
  const axis = placesBySigma(report.points, ["ellipse_a", "ellipse_b", "ellipsoid_c"], digits), turned = placesBySigma(report.images, turns.map((key) => `s${key}`), angles);
  const mixed = typeof unit !== "string";
  return {
    points: [text("id", say("point")), ...placed(report.points), fixed("ellipsoid_a", say("ellipsoid a"), axis, length), fixed("rays", say("rays"), 0), fixed("others", say("others"), 0), fixed("angle", say("intersection"), 1, meeting), fixed("mean_r", say("mean r"), 3), fixed("smallest_r", say("smallest r"), 3), fixed("largest_w", say("largest |w|"), 2), text("status", say("status"), true)],
    ellipses: [text("id", say("point")), ...["a", "b"].map((key) => fixed(`ellipse_${key}`, say(`ellipse ${key}`), axis, length)), fixed("ellipse_azimuth", say("azimuth of a"), tenths(angle), angle), ...["a", "b", "c"].flatMap((key) => [fixed(`ellipsoid_${key}`, say(`ellipsoid ${key}`), axis, length), fixed(`ellipsoid_azimuth_${key}`, say("azimuth"), tenths(angle), angle), fixed(`ellipsoid_elevation_${key}`, say("elevation"), tenths(angle), angle)])],
    attitudes: [text("id", say("image")), ...turns.map((key, k) => fixed(key, "ωφκ"[k], turned, angle)), ...turns.map((key, k) => fixed(`s${key}`, `σ${"ωφκ"[k]}`, turned, angle))],
    images: [text("id", say("image")), text("camera", say("camera")), ...placed(report.images), fixed("points", say("points"), 0), fixed("coverage", say("coverage"), 0, "%"), short("rms", say("rms v"), mixed ? "" : unit), ...(mixed ? [text("unit", say("unit"))] : []), fixed("mean_r", say("mean r"), 3), fixed("largest_w", say("largest |w|"), 2)],
    stations: [text("id", say("station")), ...placed(report.stations), fixed("orientation", say("orientation"), angles, angle), short("sorientation", say("σ orientation"), angle), fixed("height", say("height"), digits, length)],
    residuals: [text("type", say("type")), text("group", say("group")), text("at", say("at")), text("from", say("from")), text("to", say("to")), text("component", say("component")), text("unit", say("unit")), { key: "observed", title: say("observed"), digits: 9 }, short("v", "v", "", true), short("sigma", "σ"), fixed("r", "r", 3), { key: "w", title: "w", unit: "1", fixed: 2, size: true }, short("error", say("error"), "", true), short("nabla", "∇"), short("external", say("external"), "1"), short("influence", say("effect"), length, true), text("flag", say("flag"), true)],
  };
}

function longTables() {
  const columns = tableColumns();
  const toNetwork = (kind) => (row) => { pick({ kind, row }); document.getElementById("network").scrollIntoView(); };
  const options = {
    points: { onPick: toNetwork("point") },
    stations: { onPick: toNetwork("station") },
    images: { onPick: (row) => { const k = images.order.indexOf(value(report.images, "id", row)); if (k >= 0) { showImage(k); document.getElementById("images").scrollIntoView(); } } },
    residuals: { sorted: { key: "w", down: true } },
  };
  Object.assign(report, { ellipses: report.points, attitudes: report.images });
  report.tables = {};
  for (const element of document.querySelectorAll("[data-table]")) {
    const name = element.dataset.table;
    if (report[name].rows) report.tables[name] = new LongTable(element, report[name], columns[name], options[name]); else element.textContent = say("none");
  }
}

// The verdict is on the screen before anything is drawn; windows that nobody sees are not waited for.
function painted() { return new Promise((resume) => { requestAnimationFrame(() => setTimeout(resume, 0)); setTimeout(resume, 200); }); }
function pause() { return new Promise((resume) => setTimeout(resume, 0)); }

// The chart library as a file of its own, which browsers read on another thread than the one that draws.
async function loadLibrary() {
  const script = document.createElement("script"), text = await unpacked("library");
  script.src = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
  await new Promise((resolve, reject) => {
    script.onload = resolve;
    script.onerror = () => reject(new Error("plotly.js"));
    document.head.append(script);
  });
  URL.revokeObjectURL(script.src);
}

async function start() {
  const root = document.documentElement;
  await painted();
  const library = loadLibrary();
  await readData();
  prepareNetwork();
  networkControls();
  sketchNetwork();
  root.dataset.ready = "first";
  await library;
  await drawSpace();
  await pause();
  await drawPlane();
  longTables();
  await pause();
  if (document.getElementById("chart-image")) {
    prepareImages();
    if (images.order.length) { imageControls(); await showMultiples(); await pause(); await showImage(0); await pause(); }
    await drawOverlap();
  }
  for (const element of document.querySelectorAll("[data-figure]")) {
    const chart = report.figures[element.dataset.figure];
    await draw(element, () => chart);
    await pause();
  }
  root.dataset.ready = "charts";
  await takePictures();
  root.dataset.ready = "all";
  setInterval(takePictures, 1500);
}

document.getElementById("theme").addEventListener("click", () => setTheme(isDark() ? "light" : "dark"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redrawAll);
addEventListener("beforeprint", () => Object.values(report.tables || {}).forEach((table) => table.show(true)));
addEventListener("afterprint", () => Object.values(report.tables || {}).forEach((table) => table.show()));
start().catch((error) => {
  const notice = document.getElementById("broken");
  notice.hidden = false;
  notice.textContent = say("The charts could not be drawn ({message}). A current browser is needed: Firefox 113, Chrome 80, Safari 16.4 or later.", { message: error.message });
  console.error(error);
});
