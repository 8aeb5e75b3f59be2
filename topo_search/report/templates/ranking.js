// The ranking table, sorted and filtered here; only the visible rows are in the document.
const FIRST = 15;
const ON_A_PHONE = ["tree", "gap [%]", "audit"]; // columns that fit on a narrow screen, beside the one that ranks
const LAST_ON_A_DESK = "air at the tip [m/s]"; // later columns are shown on demand

const DECIMALS = { "J over bound": 4, "gap [%]": 2 }; // as in all other tables

function formatted(name, value) {
  if (DECIMALS[name]) return value.toFixed(DECIMALS[name]);
  return typeof value === "number" && value >= 1e6 ? value.toExponential(4) : value;
}

function ranking(table, comparison, choice) {
  const { columns, rows, merit } = read("ranking-data");
  const column = Object.fromEntries(columns.map(([name], i) => [name, i]));
  const words = document.getElementById("words");
  const choices = { status: document.getElementById("status"), audit: document.getElementById("audit") };
  const more = document.getElementById("more");
  const texts = rows.map((row) => row.join(" ").toLowerCase());
  const order = rows.map((_, i) => i);
  order.sort((a, b) => (rows[a][column[merit]] === null) - (rows[b][column[merit]] === null)); // designs first
  const visibility = (name) => {
    if (column[name] > column[LAST_ON_A_DESK]) return " rest detail";
    return [ranked, ...ON_A_PHONE].includes(name) ? "" : " rest";
  };
  const hasValues = columns.map((_, i) => rows.some((row) => row[i] !== null));
  const ranked = hasValues[column["J over bound"]] ? "J over bound" : merit;
  let showAll = false;

  for (const [name, select] of Object.entries(choices)) {
    const values = new Set(rows.map((row) => row[column[name]]).filter((value) => value !== null));
    for (const value of [...values].sort()) select.add(new Option(value, value));
  }

  const heading = table.tHead.insertRow();
  columns.forEach(([name, kind], i) => {
    if (!hasValues[i]) return;
    const cell = document.createElement("th");
    const button = document.createElement("button");
    cell.scope = "col";
    cell.className = kind + visibility(name);
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
    const query = words.value.toLowerCase();
    const matches = order.filter(
      (i) =>
        texts[i].includes(query) &&
        Object.entries(choices).every(([name, select]) => !select.value || rows[i][column[name]] === select.value),
    );
    const body = document.createElement("tbody");
    for (const i of showAll ? matches : matches.slice(0, FIRST)) {
      const line = body.insertRow();
      const key = rows[i][column.tree];
      if (key === comparison?.key) line.setAttribute("aria-current", "true");
      columns.forEach(([name, kind], j) => {
        if (!hasValues[j]) return;
        const cell = line.insertCell();
        const value = rows[i][j];
        if (name === "tree" && comparison?.has(key)) cell.append(comparison.thumbnail(key), opener(key));
        else cell.textContent = value === null ? "" : formatted(name, value);
        cell.className = (name === "audit" && value !== null ? value.split(", ").at(-1) : kind) + visibility(name);
      });
    }
    table.tBodies[0].replaceWith(body);
    choice?.draw(matches);
    const hidden = matches.length - body.rows.length;
    document.getElementById("shown").textContent = `${body.rows.length} of ${rows.length} candidates shown`;
    more.hidden = hidden === 0;
    more.textContent = `Show ${hidden} more`;
  }

  // A button in a row opens its design; arrow keys move to the button of the next row.
  function opener(key) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = key;
    button.setAttribute("aria-label", `${key}: compare with the best`);
    return button;
  }

  // Keys in the tables of near ties and of sizes open their designs too.
  for (const cell of document.querySelectorAll("td[data-name=key], td[data-name=best]")) {
    const key = cell.textContent;
    if (!comparison?.has(key)) continue;
    cell.replaceChildren(opener(key));
    cell.firstChild.addEventListener("click", () => comparison.show(key));
  }

  table.addEventListener("click", (event) => {
    const button = event.target.closest("tbody tr")?.querySelector("button");
    if (button) comparison.show(button.textContent);
  });
  table.addEventListener("keydown", (event) => {
    const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    const openers = [...table.tBodies[0].querySelectorAll("button")];
    const next = openers[openers.indexOf(event.target) + by];
    if (!by || !next || !openers.includes(event.target)) return;
    event.preventDefault();
    next.focus();
  });
  if (comparison) {
    comparison.chosen = (key) => {
      for (const line of table.tBodies[0].rows) {
        const same = key !== null && line.cells[0].textContent === key;
        if (same) line.setAttribute("aria-current", "true");
        else line.removeAttribute("aria-current");
      }
    };
  }

  words.addEventListener("input", show);
  for (const select of Object.values(choices)) select.addEventListener("change", show);
  document.getElementById("every").addEventListener("change", ({ target }) => table.classList.toggle("every", target.checked));
  document.getElementById("filter").addEventListener("submit", (event) => event.preventDefault());
  more.addEventListener("click", () => {
    showAll = true;
    show();
  });
  show();
}
