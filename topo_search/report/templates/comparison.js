// Two designs of the ranking side by side, by default against the winner: linked 3-D views and key figures.

class Comparison {
  constructor(element) {
    this.element = element;
    this.columns = element.querySelector(".cards").children;
    this.views = [];
    this.key = null;
    const templates = document.querySelectorAll("template[id^='card-']");
    this.keys = [...templates].map((template) => template.id.slice("card-".length));
    this.best = element.dataset.best;
    this.against = element.querySelector("[data-against]");
    this.against.addEventListener("change", () => this.show(this.key));
    document.addEventListener("keydown", (event) => event.key === "Escape" && this.key !== null && this.show(null));
    this.chosen = () => {}; // called with the key that is shown
    for (const button of element.querySelectorAll("[data-move]")) {
      button.addEventListener("click", () => this.move(Number(button.dataset.move)));
    }
    element.querySelector("[data-close]").addEventListener("click", () => this.show(null));
  }

  has(key) {
    return this.keys.includes(key);
  }

  // Opens the design that is named in the address of the page.
  follow() {
    const [key, against] = decodeURIComponent(location.hash).replace("#design=", "").split(",");
    if (this.has(against)) this.against.value = against;
    if (this.has(key)) this.show(key);
    else if (this.element.dataset.open) this.show(this.element.dataset.open, false);
  }

  thumbnail(key) {
    return document.getElementById(`card-${key}`).content.querySelector(".thumbnail").cloneNode(true);
  }

  move(by) {
    const next = this.keys.indexOf(this.key) + by;
    this.show(this.keys[Math.max(0, Math.min(this.keys.length - 1, next))]);
  }

  show(key, scroll = true) {
    for (const view of this.views) view.remove();
    this.views = [];
    this.key = key;
    this.element.hidden = key === null;
    const against = this.against.value;
    const keys = key === null ? [] : [...new Set([against, key])];
    [...this.columns].forEach((column, i) => column.replaceChildren(...(keys[i] ? [this.card(keys[i])] : [])));
    const named = (other) => (other === this.best ? `the best, ${other}` : other);
    const title = keys.length === 1 ? `${key}${key === this.best ? ", the best" : ""}` : `${key} compared with ${named(against)}`;
    if (key !== null || location.hash.startsWith("#design=")) {
      history.replaceState(null, "", key === null ? "#" : `#design=${key}${against === this.keys[0] ? "" : `,${against}`}`);
    }
    this.mark();
    this.element.querySelector("h3").textContent = key === null ? "" : title;
    this.views = [...this.element.querySelectorAll(".view")].map((view) => new View(view));
    if (this.views.length === 2) this.views[0].pair(this.views[1]);
    this.chosen(key);
    makeScrollableFocusable();
    if (key !== null && scroll) this.element.scrollIntoView({ block: "start" });
  }

  // Marks the figures in which the two designs differ.
  mark() {
    const figures = [...this.columns].map(
      (column) => new Map([...column.querySelectorAll("dt")].map((term) => [term.textContent, term.nextElementSibling.querySelector("strong")])),
    );
    for (const [name, figure] of figures[0]) {
      const other = figures[1].get(name);
      if (!other || other.textContent === figure.textContent) continue;
      for (const differing of [figure, other]) differing.classList.add("differs");
    }
  }

  card(key) {
    return document.getElementById(`card-${key}`).content.cloneNode(true);
  }
}
