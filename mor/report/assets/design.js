"use strict";
// Observations of a plan off and on: exact updates of the cofactors, row by row, from those of the plan as it is.
const plan = (() => {
  const given = JSON.parse(document.getElementById("plan").textContent);
  const doubles = (text) => new Float64Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  const n = given.unknowns, planned = doubles(given.cofactors), value = doubles(given.value);
  const rows = given.start.length - 1;
  const on = given.units.map((unit) => !unit.candidate);
  const LEAST = 1e-9; // of 1 − a Q aᵀ, below which something would be undetermined
  let Q = planned, state = null;

  // Q aᵀ of a row.
  function times(cofactors, row) {
    const found = new Float64Array(n);
    for (let k = given.start[row]; k < given.start[row + 1]; k++) {
      const from = given.column[k] * n, a = value[k];
      for (let i = 0; i < n; i++) found[i] += a * cofactors[from + i];
    }
    return found;
  }

  function along(row, vector) {
    let sum = 0;
    for (let k = given.start[row]; k < given.start[row + 1]; k++) sum += value[k] * vector[given.column[k]];
    return sum;
  }

  // The cofactors with one row more (sign 1) or less (−1), in place; false where something would be undetermined.
  function update(cofactors, row, sign) {
    const q = times(cofactors, row), pivot = 1 + sign * along(row, q);
    if (!(pivot > LEAST)) return false;
    for (let i = 0; i < n; i++) {
      const c = (sign * q[i]) / pivot;
      if (c !== 0) for (let j = 0; j < n; j++) cofactors[i * n + j] -= c * q[j];
    }
    return true;
  }

  // Always from the plan as it is, so that round-off does not add up: first what is added, then what is taken out.
  function cofactorsOf(switches) {
    const found = planned.slice();
    for (const sign of [1, -1]) {
      for (const [k, unit] of given.units.entries()) {
        if (switches[k] !== unit.candidate || (sign === 1) !== unit.candidate) continue;
        for (const row of unit.rows) if (!update(found, row, sign)) return null;
      }
    }
    return found;
  }

  function activeRows() {
    const active = new Uint8Array(rows);
    for (let row = 0; row < rows; row++) active[row] = given.group[row] < given.groups ? 1 : 0;
    for (const [k, unit] of given.units.entries()) for (const row of unit.rows) active[row] = on[k] ? 1 : 0;
    return active;
  }

  // r = 1 − a Q aᵀ of every row that takes part; of correlated ones the diagonal of I − L A Q Aᵀ L⁻¹. NaN elsewhere.
  function redundancies() {
    const active = activeRows(), r = new Float64Array(rows).fill(NaN);
    for (let row = 0; row < rows; row++) if (active[row]) r[row] = 1 - along(row, times(Q, row));
    for (const { rows: some, L, inverse } of given.correlated) {
      if (!active[some[0]]) continue;
      const columns = some.map((row) => times(Q, row));
      const K = some.map((row) => columns.map((column) => along(row, column)));
      some.forEach((row, i) => {
        let sum = 0;
        for (let j = 0; j < some.length; j++) for (let k = 0; k < some.length; k++) sum += L[i][j] * K[j][k] * inverse[k][i];
        r[row] = 1 - sum;
      });
    }
    return r;
  }

  // Covariances of a point, internal axes or those of the project.
  function inside(point) {
    const c = given.points[point].columns;
    return c.map((i) => c.map((j) => (i < 0 || j < 0 ? 0 : Q[i * n + j])));
  }
  function covariance(point) {
    const C = inside(point), M = given.axes, size = [0, 1, 2];
    return size.map((i) => size.map((j) => {
      let sum = 0;
      for (const k of size) for (const l of size) sum += M[k][i] * C[k][l] * M[l][j];
      return sum;
    }));
  }

  // The largest eigenvalue of a symmetric matrix of three, by its invariants (O. K. Smith 1961).
  function largest(C) {
    const mean = (C[0][0] + C[1][1] + C[2][2]) / 3;
    const off = C[0][1] ** 2 + C[0][2] ** 2 + C[1][2] ** 2;
    const p = Math.sqrt(((C[0][0] - mean) ** 2 + (C[1][1] - mean) ** 2 + (C[2][2] - mean) ** 2 + 2 * off) / 6);
    if (p === 0) return mean;
    const B = C.map((row, i) => row.map((entry, j) => (entry - (i === j ? mean : 0)) / p));
    const det = B[0][0] * (B[1][1] * B[2][2] - B[1][2] * B[2][1]) - B[0][1] * (B[1][0] * B[2][2] - B[1][2] * B[2][0]) + B[0][2] * (B[1][0] * B[2][1] - B[1][1] * B[2][0]);
    return mean + 2 * p * Math.cos(Math.acos(Math.min(1, Math.max(-1, det / 2))) / 3);
  }

  // The worst of what a requirement is about, and whether it is reached.
  function judged(wanted, r) {
    if (wanted.of === "sigma") {
      let worst = 0, where = "";
      for (const point of wanted.points) {
        const C = inside(point);
        const variance = wanted.components.length ? Math.max(...wanted.components.map((c) => C[c][c])) : largest(C);
        const sigma = Math.sqrt(Math.max(variance, 0));
        if (sigma > worst || !where) [worst, where] = [sigma, given.points[point].name];
      }
      return { worst, where, met: worst <= wanted.limit * (1 + 1e-9) };
    }
    let least = Infinity, row = -1;
    const groups = new Set(wanted.groups);
    for (let k = 0; k < rows; k++) if (groups.has(given.group[k]) && r[k] < least) [least, row] = [r[k], k];
    const worst = wanted.of === "r" ? least : Math.sqrt((wanted.noncentrality * (1 - least)) / Math.max(least, 0));
    return { worst, where: nameOf(row), met: least >= wanted.least - 1e-9 };
  }

  const unitOf = new Map(given.units.flatMap((unit, k) => unit.rows.map((row) => [row, k])));
  function nameOf(row) {
    const box = document.querySelector(`input[data-unit="${unitOf.get(row)}"]`);
    return box ? box.getAttribute("aria-label") : "";
  }

  const words = (english, values = {}) => given.words[english].replace(/\{(\w+)\}/g, (place, name) => values[name]);
  const local = (text) => text.replace(".", given.decimal);
  const share = (r) => (Number.isFinite(r) ? local(r >= 0.001 || r === 0 ? r.toFixed(3) : r.toExponential(1)) : "∞");
  const said = (number, digits = 4) => local(Number.isFinite(number) ? String(Number(number.toPrecision(digits))) : "∞");

  function showPoint(point) {
    const C = covariance(point), [a, b] = given.view.axes, [s, t] = given.view.signs, f = given.view.scale;
    const xx = C[a][a], yy = C[b][b], xy = s * t * C[a][b];
    const middle = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy), turn = (Math.atan2(2 * xy, xx - yy) / 2) * (180 / Math.PI);
    const ellipse = document.querySelector(`ellipse[data-point="${point}"]`);
    if (ellipse) {
      ellipse.setAttribute("rx", f * Math.sqrt(Math.max(middle + apart, 0)));
      ellipse.setAttribute("ry", f * Math.sqrt(Math.max(middle - apart, 0)));
      ellipse.setAttribute("transform", `rotate(${turn})`);
    }
    const cells = document.querySelectorAll(`tr[data-point="${point}"] td`);
    [0, 1, 2].forEach((k) => { if (cells[k + 1]) cells[k + 1].textContent = local(Math.sqrt(Math.max(C[k][k], 0)).toFixed(given.decimals)); });
  }

  function show(message = "") {
    const r = redundancies();
    let least = Infinity, row = -1;
    for (let k = 0; k < rows; k++) if (r[k] < least) [least, row] = [r[k], k];
    let active = 0, all = 0;
    given.units.forEach((unit, k) => {
      const its = Math.min(...unit.rows.map((one) => r[one]));
      const cell = document.querySelector(`td.r[data-unit="${k}"]`), box = document.querySelector(`input[data-unit="${k}"]`);
      cell.textContent = on[k] ? share(Math.max(its, 0)) : "";
      cell.classList.toggle("weak", on[k] && its < 0.1);
      box.checked = on[k];
      box.closest("tr").className = on[k] ? "on" : unit.candidate ? "candidate" : "off";
      const sight = document.querySelector(`.sight[data-unit="${k}"]`);
      if (sight) sight.setAttribute("class", `sight ${on[k] ? "on" : unit.candidate ? "candidate" : "off"}`);
      all += unit.candidate ? 0 : unit.rows.length;
      active += on[k] ? unit.rows.length : 0;
    });
    given.points.forEach((_, point) => showPoint(point));
    const judgements = given.require.map((wanted) => judged(wanted, r));
    judgements.forEach((one, k) => {
      const line = document.querySelector(`tr[data-require="${k}"]`), verdict = line.querySelector(".verdict");
      line.querySelector(".worst").textContent = said(one.worst) + (given.require[k].of === "sigma" ? ` ${given.unit}` : "");
      line.querySelector(".where").textContent = one.where;
      verdict.textContent = words(one.met ? "reached" : "NOT REACHED");
      verdict.className = `text verdict ${one.met ? "good" : "bad"}`;
    });
    const line = words("{on} of {all} observations; smallest r {r} ({place})", { on: active, all, r: share(Math.max(least, 0)), place: nameOf(row) });
    document.getElementById("state").textContent = message ? `${message} ${line}` : line;
    state = { r, judgements };
  }

  // Switch observations; false, and nothing changes, where something would be undetermined without them.
  function set(unit, wanted) {
    const before = on[unit];
    on[unit] = wanted;
    const found = cofactorsOf(on);
    if (found) Q = found;
    else on[unit] = before;
    show(found ? "" : words("This cannot be spared: something would be undetermined."));
    return found !== null;
  }

  function reset() {
    given.units.forEach((unit, k) => { on[k] = !unit.candidate; });
    Q = planned;
    show();
  }

  document.addEventListener("change", (event) => {
    const unit = event.target.dataset.unit;
    if (event.target.matches("input[data-unit]")) set(Number(unit), event.target.checked);
  });
  document.getElementById("reset").addEventListener("click", reset);
  show();
  return { set, reset, covariance, redundancies: () => Array.from(state.r), judgements: () => state.judgements };
})();
