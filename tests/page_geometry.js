(async () => {
  const ACROSS = 949; // Letter across without its margins; points and residuals are printed across
  const root = document.documentElement, end = Date.now() + 60000, waits = Boolean(document.getElementById("payload"));
  while (waits && root.dataset.ready !== "all" && Date.now() < end) await new Promise((go) => setTimeout(go, 100));
  if (THEME === "printed") {
    for (const sheet of document.styleSheets) for (const rule of sheet.cssRules) if (rule.media) rule.media.mediaText = rule.media.mediaText.includes("print") ? "all" : "not all";
    dispatchEvent(new Event("beforeprint"));
  } else if (THEME) root.dataset.theme = THEME;
  const wide = root.clientWidth, found = [];
  const across = THEME === "printed" ? [...document.querySelectorAll("#points table, #residuals table")] : [];
  for (const table of across) if (table.scrollWidth > ACROSS) found.push(`a table of ${table.scrollWidth} px does not fit paper across`);
  if (THEME !== "printed" && root.scrollWidth > wide + 1) found.push(`the page scrolls sideways: ${root.scrollWidth} of ${wide}`);
  const scrolls = (node) => node.closest(".long, .scrolls, .plain.wide, .plain.camera, .plot, datalist, svg");
  const seen = (node) => node.getClientRects().length > 0;
  for (const node of document.querySelectorAll("h1, h2, h3, p, td, th, dt, dd, button, select, input, svg, figure, .chart, img")) {
    const box = node.getBoundingClientRect();
    if (!seen(node) || (THEME === "printed" ? node.closest("#points, #residuals, .plot, datalist, svg") : scrolls(node.parentElement)) || !box.width || box.right < -900) continue;
    if (box.right > wide + 1 || box.left < -1) found.push(`${node.tagName} ${node.className} ${node.textContent.trim().slice(0, 40)}: ${box.left.toFixed(0)} to ${box.right.toFixed(0)} of ${wide}`);
    if (/^(P|TD|TH|DT|DD|H1|H2|H3)$/.test(node.tagName) && node.scrollWidth > node.clientWidth + 1 && getComputedStyle(node).display !== "inline" && node.clientWidth) found.push(`clipped: ${node.tagName} ${node.textContent.trim().slice(0, 40)}`);
  }
  const cells = [...document.querySelectorAll("dl.statements > div, nav a, .controls label, .headline, .persons span")].filter(seen).map((node) => [node, node.getBoundingClientRect()]);
  cells.forEach(([a, p], k) => cells.slice(k + 1).forEach(([b, q]) => {
    if (a.contains(b) || b.contains(a)) return;
    if (p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 1 && q.top < p.bottom - 1 && (a.closest("nav") === null) === (b.closest("nav") === null)) found.push(`overlap: ${a.textContent.trim().slice(0, 30)} and ${b.textContent.trim().slice(0, 30)}`);
  }));
  const names = document.querySelectorAll("#chart-plan .plot .textpoint text, #chart-plan .plot g.text text, #chart-plan .annotation-text-g text"); // the bar of ellipses has words, too
  const boxes = [...names].filter((node) => node.textContent && seen(node)).map((node) => node.getBoundingClientRect());
  let meeting = 0;
  boxes.forEach((p, k) => boxes.slice(k + 1).forEach((q) => { if (p.left < q.right - 2 && q.left < p.right - 2 && p.top < q.bottom - 4 && q.top < p.bottom - 4) meeting++; }));
  if (meeting) found.push(`${meeting} names of the network overlap`);
  // Words in charts: inside of their chart, none over another. Words that stand askew have boxes that say nothing.
  const askew = (node) => { const m = node.getScreenCTM(); return Math.abs(m.a) > 0.02 && Math.abs(m.b) > 0.02; };
  for (const chart of document.querySelectorAll(".chart")) {
    const plot = chart.querySelector(".plot"), frame = chart.getBoundingClientRect(), name = chart.id || chart.dataset.figure;
    if (!plot || !seen(plot)) continue;
    if (!plot.querySelector(".main-svg")) { found.push(`chart ${name} is not drawn`); continue; }
    const texts = [...plot.querySelectorAll(".main-svg text")].filter((node) => node.textContent.trim() && seen(node) && !askew(node) && !node.closest(".textpoint, .hoverlayer, .scatterlayer") && getComputedStyle(node).opacity !== "0");
    const placed = texts.map((node) => [node.textContent.trim().slice(0, 30), node.getBoundingClientRect()]).filter(([, box]) => box.width);
    for (const [text, p] of placed) if (p.left < frame.left - 2 || p.right > frame.right + 2 || p.top < frame.top - 2 || p.bottom > frame.bottom + 2) found.push(`chart ${name}: "${text}" is cut off`);
    placed.forEach(([one, p], k) => placed.slice(k + 1).forEach(([other, q]) => { if (p.left < q.right - 2 && q.left < p.right - 2 && p.top < q.bottom - 3 && q.top < p.bottom - 3) found.push(`chart ${name}: "${one}" over "${other}"`); }));
  }
  parent.postMessage(JSON.stringify({ ready: root.dataset.ready || "", names: boxes.length, found }), "*");
})();
