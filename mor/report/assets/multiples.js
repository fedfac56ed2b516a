"use strict";
// Residual vectors of many images side by side: all of a small block, of a large one those with the largest test values.
const MOST_IMAGES = 24, MOST_FEET = 8000;
const PANEL = { columns: 6, title: 34, below: 6, gap: 10, bar: 0.16 };

function chosenImages() {
  if (images.order.length <= MOST_IMAGES) return images.order;
  const largest = (name) => value(report.images, "largest_w", imageOf(name).number) || 0;
  return [...images.order].sort((a, b) => largest(b) - largest(a)).slice(0, MOST_IMAGES);
}

// Columns, rows and height of the panels in a chart of this width.
function grid(names, width) {
  const columns = Math.min(PANEL.columns, Math.max(names.length, 3), Math.max(2, Math.floor(width / 170))), rows = Math.ceil(names.length / columns);
  const ratio = Math.max(...names.map((name) => { const { x, y } = imageOf(name).area; return ((1 + PANEL.bar) * (y[1] - y[0])) / (x[1] - x[0]); }));
  const panel = (width / columns - PANEL.gap) * Math.min(ratio, 1.5);
  return { columns, rows, height: Math.ceil(rows * (panel + PANEL.title + PANEL.below)) };
}

function shortened(name) { return name.length > 20 ? `${name.slice(0, 9)}…${name.slice(-10)}` : name; }

function panelTitle(name, image) {
  const escaped = shortened(name).replace(/&/g, "&amp;").replace(/</g, "&lt;");
  const coverage = shown(value(report.images, "coverage", image.number), { fixed: 0 }), largest = shown(value(report.images, "largest_w", image.number), { fixed: 1 });
  return `<b>${escaped}</b><br>${coverage} % · |w| ≤ ${largest}`;
}

function multiplesChart() {
  const element = document.getElementById("chart-multiples"), names = chosenImages();
  const { columns, rows, height } = grid(names, images.width);
  const data = [], layout = { showlegend: false, margin: { l: 0, r: 0, t: 0, b: 0 }, annotations: [], hovermode: false, dragmode: false };
  const feet = names.reduce((sum, name) => sum + images.rows.get(name).length, 0) <= MOST_FEET;
  names.forEach((name, k) => {
    const image = imageOf(name), { area } = image, ending = k ? String(k + 1) : "", width = area.x[1] - area.x[0], extent = area.y[1] - area.y[0];
    const scale = vectorScale(image.camera, 0.1), bar = barOf(image), axes = { type: "scatter", mode: "lines", xaxis: `x${ending}`, yaxis: `y${ending}`, hoverinfo: "skip" };
    const level = area.down ? area.y[1] + 0.09 * extent : area.y[0] - 0.09 * extent, [x0, x1] = area.x, [y0, y1] = area.y;
    data.push({ ...axes, x: [x0, x1, x1, x0, x0], y: [y0, y0, y1, y1, y0], line: { color: PALETTE.grey, width: 1, dash: area.known ? "solid" : "dot" }, meta: "frame" });
    data.push({ ...axes, ...hullLine(image), meta: "covered" });
    if (feet) data.push({ ...axes, mode: "markers", x: image.column("x"), y: image.column("y"), marker: { size: 2.5, color: PALETTE.blue }, meta: "points" });
    data.push({ ...axes, ...vectorLines(image, scale, false), line: { color: PALETTE.blue, width: 1.2 }, meta: "vectors" });
    data.push({ ...axes, ...vectorLines(image, scale, true), line: { color: PALETTE.red, width: 2.5 }, meta: "flagged" });
    data.push({ ...axes, x: [x0, x0 + scale * bar], y: [level, level], line: { color: PALETTE.orange, width: 3 }, meta: "bar" });
    const column = k % columns, row = Math.floor(k / columns), gap = PANEL.gap / 2 / images.width;
    const top = 1 - row / rows, bottom = 1 - (row + 1) / rows, margin = 0.01 * width;
    layout[`xaxis${ending}`] = { visible: false, domain: [column / columns + gap, (column + 1) / columns - gap], anchor: `y${ending}`, range: [x0 - margin, x1 + margin], constrain: "domain", fixedrange: true };
    layout[`yaxis${ending}`] = { visible: false, domain: [bottom + PANEL.below / height, top - PANEL.title / height], anchor: `x${ending}`, scaleanchor: `x${ending}`, scaleratio: 1, range: area.down ? [y1 + PANEL.bar * extent, y0 - margin] : [y0 - PANEL.bar * extent, y1 + margin], constrain: "domain", constraintoward: "top", fixedrange: true };
    layout.annotations.push({ xref: "paper", yref: "paper", x: column / columns + gap, y: top, xanchor: "left", yanchor: "top", align: "left", text: panelTitle(name, image), showarrow: false, font: { size: 10 }, captureevents: true, name });
    layout.annotations.push({ xref: `x${ending}`, yref: `y${ending}`, x: x0 + scale * bar, y: level, xanchor: "left", xshift: 4, text: readable(bar, image.unit), showarrow: false, font: { size: 9 } });
  });
  element.style.height = `${height}px`;
  element.dataset.share = height / images.width;
  return { data, layout };
}

// Length of residual that the bar of an image stands for.
function barOf({ camera, area }) { return roundLength((0.2 * (area.x[1] - area.x[0])) / vectorScale(camera, 0.1)); }

function multiplesWords(names) {
  const cameras = new Map(names.map((name) => { const image = imageOf(name); return [image.camera, image]; }));
  const said = [...cameras].map(([camera, { area, unit }]) => {
    const [width, height] = [area.x, area.y].map(([low, high]) => Number((high - low).toPrecision(4)));
    const frame = area.known ? say("frame = image format") : say("frame = area measured in");
    return say("Camera {camera}: {frame}, {width} × {height} {unit}, vectors enlarged {scale} times.", { camera, frame, width, height, unit, scale: vectorScale(camera, 0.1) });
  });
  return [
    ...said,
    say("Orange bar: length of a residual as written. Grey: covered by the points of the image, in per cent of the frame; |w|: largest test value of the image; red: flagged. Click a name to see that image large."),
  ].join(" ");
}

async function showMultiples() {
  const element = document.getElementById("chart-multiples"), names = chosenImages();
  images.width = Math.max(element.clientWidth, 320);
  document.getElementById("multiples-title").textContent = names.length < images.order.length
    ? say("The {count} images with the largest test values, of {all}", { count: names.length, all: report.images.rows })
    : say("{count:image|images} side by side", { count: names.length });
  document.getElementById("multiples-note").textContent = multiplesWords(names);
  await draw(element, multiplesChart);
  element.querySelector(".plot").on("plotly_clickannotation", ({ annotation }) => {
    const number = images.order.indexOf(annotation.name);
    if (number >= 0) { showImage(number); document.getElementById("chart-image").scrollIntoView({ block: "center" }); }
  });
}
