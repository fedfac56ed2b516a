"use strict";
// The packed data of this page: unpacking, and numbers as text.
const report = {};

async function unpacked(id) {
  const element = document.getElementById(id);
  const letters = atob(element.textContent.trim());
  element.textContent = "";
  const bytes = new Uint8Array(letters.length);
  for (let k = 0; k < letters.length; k++) bytes[k] = letters.charCodeAt(k); // ten times as fast as Uint8Array.from
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

const KINDS = { f4: Float32Array, f8: Float64Array, i1: Int8Array, i2: Int16Array, i4: Int32Array };

async function readData() {
  const buffer = await unpacked("payload");
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const start = 4 + length;
  for (const table of Object.values(head)) {
    for (const column of Object.values((table && table.columns) || {})) {
      if (column.k) column.values = new KINDS[column.k](buffer, start + column.o, column.n);
    }
  }
  Object.assign(report, head);
}

// A sentence in the language of the page; the English one is the key. {count:point|points} says 1 point, 2 points.
function say(english, values = {}) {
  const text = (report.meta && report.meta.words[english]) || english;
  return text.replace(/\{(\w+)(?::([^|{}]*)\|([^{}]*))?\}/g, (place, name, one, many) => (!(name in values) ? place : one === undefined ? values[name] : `${values[name]} ${Number(values[name]) === 1 ? one : many}`));
}

function value(table, name, row) {
  const column = table.columns[name];
  if (!column) return undefined;
  const entry = column.values[row];
  return column.t ? column.t[entry] : entry;
}

function numbers(table, name) { return Array.from(table.columns[name].values, (x) => (Number.isNaN(x) ? null : x)); }
function texts(table, name) { const { t, values } = table.columns[name]; return Array.from(values, (k) => t[k]); }
function has(table, name) { return Boolean(table && table.columns[name] && table.rows); }

function minus(text) { return text.replace(/-/g, "\u2212"); }
function shown(x, format) {
  if (x === undefined || x === null || Number.isNaN(x)) return "\u2013";
  if (typeof x === "string") return x;
  if (format && format.fixed !== undefined) return minus(x.toFixed(format.fixed));
  const digits = (format && format.digits) || 4;
  const text = x === 0 ? "0" : x.toPrecision(digits);
  return minus(text.includes("e") ? Number(text).toExponential(Math.max(digits - 2, 1)) : text);
}
// 1, 2 or 5 times a power of ten, not above x
function roundLength(x) {
  if (!(x > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(x));
  return power * [5, 2, 1].find((step) => step * power <= x * (1 + 1e-12));
}
// Unit and factor in which a length reads well: mm instead of 0.0004 m
function finer(x, unit) {
  const smaller = { m: [["mm", 1e3], ["\u00b5m", 1e6]], mm: [["\u00b5m", 1e3]] }[unit] || [];
  let said = [unit, 1];
  for (const [name, factor] of smaller) if (x * said[1] < 0.1) said = [name, factor];
  return said;
}
function readable(x, unit) {
  const [name, factor] = finer(x, unit);
  return `${Number((x * factor).toPrecision(4))} ${name}`;
}
