"use strict";
// Long tables: only the rows in sight exist; sorted and filtered as numbers or texts.
const ROW = 24;
const PRINTED = 40; // rows on paper

class LongTable {
  constructor(element, table, columns, options = {}) {
    this.element = element;
    this.table = table;
    this.columns = columns.filter((column) => filled(table.columns[column.key]));
    for (const { key } of this.columns.filter((column) => column.words)) table.columns[key].shown = table.columns[key].t.map((word) => say(word));
    this.options = options;
    this.filters = new Map();
    this.sorted = options.sorted || null;
    this.build();
    this.choose();
  }

  build() {
    this.element.innerHTML = '<div class="long" tabindex="0"><table><thead><tr></tr><tr></tr></thead><tbody></tbody></table></div><p class="quiet state"></p><p class="quiet more"></p>';
    const [titles, inputs] = this.element.querySelectorAll("thead tr");
    for (const column of this.columns) {
      const title = document.createElement("th"), button = document.createElement("button");
      title.className = column.text ? "text" : "";
      button.type = "button";
      button.addEventListener("click", () => this.sortBy(column.key));
      title.append(button);
      titles.append(title);
      const cell = document.createElement("th"), input = document.createElement("input");
      input.setAttribute("aria-label", say("Filter {column}", { column: column.title }));
      input.addEventListener("input", () => this.filterBy(column.key, input.value));
      cell.append(input);
      inputs.append(cell);
    }
    this.scroller = this.element.querySelector(".long");
    this.body = this.element.querySelector("tbody");
    this.scroller.addEventListener("scroll", () => this.show());
  }

  sortBy(key) {
    const down = this.sorted && this.sorted.key === key ? !this.sorted.down : !this.columns.find((c) => c.key === key).text;
    this.sorted = { key, down };
    this.choose();
  }

  filterBy(key, text) {
    if (text.trim()) this.filters.set(key, test(text.trim(), this.table.columns[key])); else this.filters.delete(key);
    this.choose();
  }

  choose() {
    const rows = [];
    const filters = [...this.filters].map(([key, passes]) => [this.table.columns[key].values, passes]);
    for (let row = 0; row < this.table.rows; row++) if (filters.every(([values, passes]) => passes(values[row]))) rows.push(row);
    if (this.sorted) this.sort(rows);
    this.rows = rows;
    this.heads();
    this.scroller.scrollTop = 0;
    this.show();
    const words = rows.length === this.table.rows ? say("{count:row|rows}.", { count: rows.length }) : say("{count} of {all} rows.", { count: rows.length, all: this.table.rows });
    this.element.querySelector(".state").textContent = words;
    const more = Math.max(0, rows.length - PRINTED), said = say("{count:more row is|more rows are} in {file}.", { count: more, file: this.element.dataset.file });
    this.element.querySelector(".more").textContent = more ? said : "";
  }

  sort(rows) {
    const { key, down } = this.sorted;
    const { values, t } = this.table.columns[key];
    const size = this.columns.find((column) => column.key === key).size;
    let rank = values;
    if (t) {
      const order = t.map((_, k) => k).sort((a, b) => t[a].localeCompare(t[b], report.meta.language, { numeric: true }));
      rank = new Int32Array(t.length);
      order.forEach((k, place) => { rank[k] = place; });
      rank = Array.from(values, (k) => rank[k]);
    } else if (size) rank = Float64Array.from(values, Math.abs);
    const sign = down ? -1 : 1;
    rows.sort((a, b) => {
      const x = rank[a], y = rank[b];
      if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y) || a - b;
      return sign * (x - y) || a - b;
    });
  }

  heads() {
    this.element.querySelectorAll("thead tr:first-child th").forEach((head, k) => {
      const column = this.columns[k], mine = this.sorted && this.sorted.key === column.key;
      head.firstChild.textContent = `${column.title}${mine ? (this.sorted.down ? " ▼" : " ▲") : ""}\n${column.unit ? `[${column.unit}]` : "\u00a0"}`;
      head.dataset.title = head.firstChild.textContent;
      head.setAttribute("aria-sort", mine ? (this.sorted.down ? "descending" : "ascending") : "none");
    });
  }

  // The rows in sight, with room for the others above and below.
  show(all) {
    const first = all ? 0 : Math.max(0, Math.floor(this.scroller.scrollTop / ROW) - 10);
    const last = Math.min(this.rows.length, all ? PRINTED : first + Math.ceil(this.scroller.clientHeight / ROW) + 24);
    const parts = [document.createDocumentFragment()];
    parts[0].append(this.space(first));
    for (let place = first; place < last; place++) parts[0].append(this.line(this.rows[place]));
    if (!all) parts[0].append(this.space(this.rows.length - last));
    this.body.replaceChildren(parts[0]);
  }

  space(count) {
    const row = document.createElement("tr");
    row.style.height = `${count * ROW}px`;
    return row;
  }

  word(key, number) { const { shown, values } = this.table.columns[key]; return shown[values[number]]; }

  line(number) {
    const row = document.createElement("tr");
    for (const column of this.columns) {
      const cell = row.insertCell();
      cell.textContent = shown(column.words ? this.word(column.key, number) : value(this.table, column.key, number), column);
      if (column.text) { cell.className = cell.textContent.length > 16 ? "text breaks" : "text"; cell.title = cell.textContent; }
    }
    const flag = value(this.table, "flag", number);
    if (flag === "gross") row.className = "gross"; else if (flag) row.className = "soft";
    if (this.options.onPick) {
      row.tabIndex = 0;
      row.addEventListener("click", () => this.options.onPick(number));
      row.addEventListener("keydown", (event) => { if (event.key === "Enter") this.options.onPick(number); });
    }
    return row;
  }
}

// False for a column that is missing or empty throughout
function filled(column) {
  if (!column) return false;
  return column.t ? column.t.some((entry) => entry !== "") : column.values.some((entry) => !Number.isNaN(entry));
}

// "abc" part of a text; ">3", "<=0.1", "=2", "|>3|" for numbers
function test(text, column) {
  if (column.t) {
    const wanted = text.toLowerCase();
    const exact = wanted.startsWith("=");
    const passes = (column.shown || column.t).map((entry) => (exact ? entry.toLowerCase() === wanted.slice(1) : entry.toLowerCase().includes(wanted)));
    return (entry) => passes[entry];
  }
  const match = /^(\|)?\s*(<=|>=|<|>|=)?\s*([-+\u2212]?[\d.,]+(?:e[-+]?\d+)?)\s*\|?$/i.exec(text);
  if (!match) return () => true;
  const size = match[1] ? Math.abs : (x) => x, limit = Number(match[3].replace("\u2212", "-").replace(",", "."));
  const compare = { "<": (x) => x < limit, ">": (x) => x > limit, "<=": (x) => x <= limit, ">=": (x) => x >= limit };
  const chosen = compare[match[2]] || ((x) => Math.abs(x - limit) <= 1e-9 * Math.max(1, Math.abs(limit)));
  return (x) => chosen(size(x));
}
