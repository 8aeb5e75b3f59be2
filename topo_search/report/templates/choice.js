// The plot to choose a design by: two figures of every audited design that passes the filters, and the Pareto front.

class Choice {
  constructor(comparison) {
    const { columns, rows, merit } = read("ranking-data");
    this.plot = document.getElementById("choice");
    this.rows = rows;
    this.index = Object.fromEntries(columns.map(([name], i) => [name, i]));
    this.better = Object.fromEntries(columns.map(([name, , better]) => [name, better]));
    this.sizes = [...new Set(rows.map((row) => row[this.index.modules]))].sort((a, b) => a - b);
    this.shown = rows.map((_, i) => i);
    const audited = rows.filter((row) => row[this.index.audit] !== null);
    const names = columns
      .filter(([, , better], i) => better && new Set(audited.map((row) => row[i]).filter((x) => x !== null)).size > 1)
      .map(([name]) => name);
    const first = (preferred) => preferred.find((name) => names.includes(name)) ?? names[0];
    const defaults = { up: first([merit]), across: first(["force reserve, any direction [N]", "hinge error [°]", "clearance [mm]"]) };
    this.selects = Object.entries(defaults).map(([id, name]) => {
      const select = document.getElementById(id);
      for (const option of names) select.add(new Option(option, option, false, option === name));
      select.addEventListener("change", () => this.draw(this.shown));
      return select;
    });
    this.comparison = comparison;
  }

  // Draws the rows with these indices.
  draw(shown) {
    this.shown = shown;
    const [y, x] = this.selects.map((select) => select.value);
    const { index, rows, sizes } = this;
    const { layout } = read("choice-data");
    const at = (i, name) => rows[i][index[name]];
    const drawn = shown.filter((i) => at(i, "audit") !== null && at(i, x) !== null && at(i, y) !== null);
    const verdicts = { clear: "circle", "clear, fragile": "diamond" };
    const trace = (chosen, more) => ({ x: chosen.map((i) => at(i, x)), y: chosen.map((i) => at(i, y)), ...more });
    const traces = sizes.map((n, k) => {
      const chosen = drawn.filter((i) => at(i, "modules") === n);
      const marker = { color: layout.colorway[k % layout.colorway.length], size: 9, symbol: chosen.map((i) => verdicts[at(i, "audit")] ?? "x") };
      const text = chosen.map((i) => `${at(i, "tree")}, audit ${at(i, "audit")}`);
      const hovertemplate = `%{text}<br>${x}: %{x}<br>${y}: %{y}<extra></extra>`;
      return trace(chosen, { name: `${n} modules`, customdata: chosen.map((i) => at(i, "tree")), mode: "markers", marker, text, hovertemplate });
    });
    const line = { color: "#bbbbbb", width: 1.5, dash: "dot" };
    traces.unshift(trace(this.front(drawn, x, y), { name: "front of clear designs", mode: "lines", line, hoverinfo: "skip" }));
    for (const [axis, text] of [["xaxis", x], ["yaxis", y]]) {
      layout[axis] = { ...layout[axis], title: { text }, exponentformat: "power" };
    }
    draw(this.plot, traces, layout).then(() => {
      this.plot.removeAllListeners("plotly_click");
      this.plot.on("plotly_click", ({ points }) => this.open(points[0].customdata));
    });
  }

  open(key) {
    if (this.comparison?.has(key)) this.comparison.show(key);
  }

  // Returns the clear designs that no other design beats in both figures.
  front(drawn, x, y) {
    const cost = (i, name) => (this.better[name] === "more" ? -1 : 1) * this.rows[i][this.index[name]];
    const clear = drawn.filter((i) => this.rows[i][this.index.audit].startsWith("clear"));
    clear.sort((a, b) => cost(a, x) - cost(b, x) || cost(a, y) - cost(b, y));
    let lowest = Infinity;
    return clear.filter((i) => cost(i, y) < lowest && ((lowest = cost(i, y)), true));
  }
}
