"use strict";
// Charts take their colours from the page, light or dark, and leave a picture of themselves for print.
const PALETTE = { blue: "#3b8fd0", orange: "#e69f00", green: "#009e73", red: "#d55e00", purple: "#cc79a7", grey: "#8a8f98" };
// Viridis without the end that the ground would swallow: small values far from the ground first, large ones last.
const SEQUENCES = {
  light: [[0, "#440154"], [0.35, "#31688e"], [0.7, "#35b779"], [1, "#d8a800"]],
  dark: [[0, "#5b7fc7"], [0.35, "#2fa3a0"], [0.7, "#7ad151"], [1, "#fde725"]],
};
const charts = new Map();

// Colours by name, asked of the browser once for each theme: every question makes it work out its styles anew.
const shades = new Map();
function css(name) {
  const key = `${isDark()} ${name}`;
  if (!shades.has(key)) shades.set(key, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return shades.get(key);
}

function themed(layout) {
  const axis = { exponentformat: "power", minexponent: 5, gridcolor: css("--grid"), zerolinecolor: css("--line"), linecolor: css("--line"), automargin: true };
  const result = {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    separators: ".", // thousands are not set apart, as nowhere else in the report
    font: { color: css("--ink"), family: 'system-ui, "Segoe UI", "DejaVu Sans", sans-serif', size: 12 },
    margin: { l: 60, r: 20, t: 34, b: 50 }, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
    modebar: { bgcolor: "rgba(0,0,0,0)", color: css("--quiet"), activecolor: css("--accent") },
    hoverlabel: { bgcolor: css("--panel"), bordercolor: css("--line"), font: { color: css("--ink") } },
    ...layout,
  };
  for (const name of ["xaxis", "yaxis"]) result[name] = { ...axis, ...result[name] };
  if (result.xaxis.type === "category" && result.xaxis.nticks) result.xaxis.nticks = Math.min(result.xaxis.nticks, Math.round(window.innerWidth / 24));
  if (layout.scene) {
    const wall = { exponentformat: "power", minexponent: 5, gridcolor: css("--line"), zerolinecolor: css("--line"), color: css("--ink"), showbackground: false };
    result.scene = { ...layout.scene };
    for (const name of ["xaxis", "yaxis", "zaxis"]) result.scene[name] = { ...wall, ...layout.scene[name] };
  }
  return result;
}

const CONFIG = { responsive: true, displaylogo: false, displayModeBar: "hover", modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d", "sendChartToCloud"] };

// One element, one chart: drawn anew from data that `make` returns.
async function draw(element, make, onClick) {
  let plot = element.querySelector(".plot");
  if (!plot) {
    plot = document.createElement("div");
    plot.className = "plot";
    plot.style.height = "100%";
    const picture = document.createElement("img");
    picture.className = "picture";
    picture.alt = element.getAttribute("aria-label") || "";
    element.append(plot, picture);
  }
  const { data, layout } = make();
  await Plotly.react(plot, data, themed(layout), CONFIG);
  element.querySelector(".sketch")?.remove();
  if (!charts.has(element) && onClick) plot.on("plotly_click", onClick);
  charts.set(element, make);
  stale.add(element);
}

// Pictures for print are made when nothing else is to be done.
const stale = new Set();
let taking = false;
async function takePictures() {
  if (taking) return;
  taking = true;
  for (const element of [...stale]) {
    stale.delete(element);
    const plot = element.querySelector(".plot");
    const { data, layout } = charts.get(element)();
    const small = element.closest(".columns"), width = small ? 560 : 1000;
    const height = Math.round(width * (Number(element.dataset.share) || (element.classList.contains("tall") ? 0.62 : small ? 0.72 : 0.5)));
    const kept = plot.layout.scene ? { ...layout, scene: { ...layout.scene, camera: plot.layout.scene.camera } } : layout;
    const root = document.documentElement, before = root.dataset.theme;
    root.dataset.theme = "light";
    const figure = { data, layout: { ...themed(kept), width, height, paper_bgcolor: "#fff" } };
    if (before) root.dataset.theme = before; else delete root.dataset.theme;
    element.querySelector(".picture").src = await Plotly.toImage(figure, { format: plot.layout.scene ? "png" : "svg", width, height });
    await new Promise((resume) => setTimeout(resume, 0));
  }
  taking = false;
}

async function redrawAll() { for (const [element, make] of charts) await draw(element, make); }

function setTheme(name) {
  document.documentElement.dataset.theme = name;
  redrawAll();
}
function isDark() {
  return (document.documentElement.dataset.theme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
}
