"use strict";

// Every figure is drawn from the JSON that follows its element.
function read(id) {
  return JSON.parse(document.getElementById(id).textContent);
}

const options = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] };
for (const element of document.querySelectorAll("[data-figure]")) {
  const figure = read(element.dataset.figure);
  Plotly.newPlot(element, figure.data, figure.layout, options);
}

// What lies around the platform can be left out: the view then comes as close as the platform is small.
for (const button of document.querySelectorAll("[data-alone]")) {
  button.addEventListener("click", () => {
    const view = document.getElementById("view");
    const around = view.data.flatMap((trace, i) => (trace.meta === "around the platform" ? [i] : []));
    Plotly.restyle(view, { visible: button.dataset.alone === "true" ? "legendonly" : true }, around);
  });
}

// Paper cannot be unfolded.
const folded = document.querySelectorAll("details:not([open])");
window.addEventListener("beforeprint", () => folded.forEach((details) => (details.open = true)));
window.addEventListener("afterprint", () => folded.forEach((details) => (details.open = false)));

// The ranking: sorted and filtered here, with as many rows in the document as are looked at.
const FIRST = 100;

function written(value) {
  return typeof value === "number" && value >= 1e6 ? value.toExponential(4) : value;
}

function ranking(table) {
  const { columns, rows } = read("ranking-data");
  const place = Object.fromEntries(columns.map(([name], i) => [name, i]));
  const words = document.getElementById("words");
  const choices = { status: document.getElementById("status"), audit: document.getElementById("audit") };
  const more = document.getElementById("more");
  const texts = rows.map((row) => row.join(" ").toLowerCase());
  const order = rows.map((_, i) => i);
  const used = columns.map((_, i) => rows.some((row) => row[i] !== null));
  let all = false;

  for (const [name, select] of Object.entries(choices)) {
    const values = new Set(rows.map((row) => row[place[name]]).filter((value) => value !== null));
    for (const value of [...values].sort()) select.add(new Option(value, value));
  }

  const heading = table.tHead.insertRow();
  columns.forEach(([name, kind], i) => {
    if (!used[i]) return;
    const cell = document.createElement("th");
    const button = document.createElement("button");
    cell.scope = "col";
    cell.className = kind;
    button.type = "button";
    button.textContent = name;
    button.addEventListener("click", () => sort(i, cell));
    cell.append(button);
    heading.append(cell);
  });

  function sort(i, cell) {
    const up = cell.getAttribute("aria-sort") !== "ascending";
    for (const other of heading.cells) other.removeAttribute("aria-sort");
    cell.setAttribute("aria-sort", up ? "ascending" : "descending");
    const sign = up ? 1 : -1;
    order.sort((a, b) => {
      const [x, y] = [rows[a][i], rows[b][i]];
      if (x === null || y === null) return (x === null) - (y === null) || a - b; // empty cells come last
      const difference = columns[i][1] === "number" ? x - y : x < y ? -1 : x > y ? 1 : 0;
      return sign * difference || a - b;
    });
    show();
  }

  function show() {
    const wanted = words.value.toLowerCase();
    const found = order.filter(
      (i) =>
        texts[i].includes(wanted) &&
        Object.entries(choices).every(([name, select]) => !select.value || rows[i][place[name]] === select.value),
    );
    const body = document.createElement("tbody");
    for (const i of all ? found : found.slice(0, FIRST)) {
      const line = body.insertRow();
      columns.forEach(([name, kind], j) => {
        if (!used[j]) return;
        const cell = line.insertCell();
        const value = rows[i][j];
        cell.textContent = value === null ? "" : written(value);
        cell.className = name === "audit" && value !== null ? value : kind;
      });
    }
    table.tBodies[0].replaceWith(body);
    const hidden = found.length - body.rows.length;
    document.getElementById("shown").textContent = `${body.rows.length} of ${rows.length} candidates shown`;
    more.hidden = hidden === 0;
    more.textContent = `Show ${hidden} more`;
  }

  words.addEventListener("input", show);
  for (const select of Object.values(choices)) select.addEventListener("change", show);
  document.getElementById("filter").addEventListener("submit", (event) => event.preventDefault());
  more.addEventListener("click", () => {
    all = true;
    show();
  });
  show();
}

const table = document.getElementById("ranking");
if (table) ranking(table);
