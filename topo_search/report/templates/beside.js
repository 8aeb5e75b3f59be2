// A design of the ranking beside the winner: both in 3-D, turned together, with their figures.

class Beside {
  constructor(element) {
    this.element = element;
    this.places = element.querySelector(".cards").children;
    this.views = [];
    this.key = null;
    const templates = document.querySelectorAll("template[id^='card-']");
    this.keys = [...templates].map((template) => template.id.slice("card-".length));
    this.winner = this.keys[0];
    this.chosen = () => {}; // told which key is shown
    for (const button of element.querySelectorAll("[data-move]")) {
      button.addEventListener("click", () => this.move(Number(button.dataset.move)));
    }
    element.querySelector("[data-close]").addEventListener("click", () => this.show(null));
  }

  has(key) {
    return this.keys.includes(key);
  }

  move(by) {
    const next = this.keys.indexOf(this.key) + by;
    this.show(this.keys[Math.max(0, Math.min(this.keys.length - 1, next))]);
  }

  show(key) {
    for (const view of this.views) view.remove();
    this.views = [];
    this.key = key;
    this.element.hidden = key === null;
    const keys = key === null ? [] : [...new Set([this.winner, key])];
    [...this.places].forEach((place, i) => place.replaceChildren(...(keys[i] ? [this.card(keys[i])] : [])));
    const title = keys.length === 1 ? `${key}, the best` : `${key} beside the best, ${this.winner}`;
    this.element.querySelector("h3").textContent = key === null ? "" : title;
    this.views = [...this.element.querySelectorAll(".view")].map((view) => new View(view));
    if (this.views.length === 2) this.views[0].pair(this.views[1]);
    this.chosen(key);
    reachable();
    if (key !== null) this.element.scrollIntoView({ block: "start" });
  }

  card(key) {
    return document.getElementById(`card-${key}`).content.cloneNode(true);
  }
}
