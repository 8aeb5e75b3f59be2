drawFigures();
const element = document.getElementById("beside");
const comparison = element && new Comparison(element);
const views = [...document.querySelectorAll(".view")].map((element) => new View(element));

function redraw() {
  drawFigures();
  for (const view of [...views, ...(comparison?.views ?? [])]) view.load();
  choice?.draw(choice.shown);
}

prefersDark.addEventListener("change", redraw);
document.getElementById("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = dark() ? "light" : "dark";
  redraw();
});

// Print with a white background and everything unfolded.
const folded = document.querySelectorAll("details:not([open])");
function setPrinting(on) {
  const wasDark = dark();
  printing = on;
  folded.forEach((details) => (details.open = on));
  if (dark() !== wasDark) redraw();
  for (const view of views) view.setPrinting(on);
}
window.addEventListener("beforeprint", () => setPrinting(true));
window.addEventListener("afterprint", () => setPrinting(false));

// Elements that scroll sideways get keyboard focus.
function makeScrollableFocusable() {
  for (const element of document.querySelectorAll(".wide, pre, nav")) {
    if (element.scrollWidth > element.clientWidth) element.tabIndex = 0;
    else element.removeAttribute("tabindex");
  }
}
window.addEventListener("resize", makeScrollableFocusable);

// The contents mark the section that is being read.
const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
const observer = new IntersectionObserver(
  (entries) => {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) continue;
      for (const link of links.values()) link.removeAttribute("aria-current");
      links.get(target.id)?.setAttribute("aria-current", "true");
    }
  },
  { rootMargin: "-60px 0px -70% 0px" },
);
document.querySelectorAll("main section").forEach((section) => observer.observe(section));

const table = document.getElementById("ranking");
const choice = document.getElementById("choice") && new Choice(comparison);
if (table) ranking(table, comparison, choice);
makeScrollableFocusable();
comparison?.follow();

// A link to a folded section unfolds it, and its charts are resized.
for (const details of document.querySelectorAll("details")) {
  details.addEventListener("toggle", () => details.querySelectorAll(".js-plotly-plot").forEach((plot) => Plotly.Plots.resize(plot)));
}
for (const link of document.querySelectorAll("nav a")) {
  link.addEventListener("click", () => document.querySelector(`${link.hash} > details`)?.setAttribute("open", ""));
}
