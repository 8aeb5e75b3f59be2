drawFigures();
const element = document.getElementById("beside");
const beside = element && new Beside(element);
const views = [...document.querySelectorAll(".view")].map((element) => new View(element));

function redraw() {
  drawFigures();
  for (const view of [...views, ...(beside?.views ?? [])]) view.load();
  choice?.draw(choice.shown);
}

dusk.addEventListener("change", redraw);
document.getElementById("theme").addEventListener("click", () => {
  document.documentElement.dataset.theme = dark() ? "light" : "dark";
  redraw();
});

// Paper is white and cannot be unfolded.
const folded = document.querySelectorAll("details:not([open])");
function onPaper(is) {
  const before = dark();
  printing = is;
  folded.forEach((details) => (details.open = is));
  if (dark() !== before) redraw();
  for (const view of views) view.paper(is);
}
window.addEventListener("beforeprint", () => onPaper(true));
window.addEventListener("afterprint", () => onPaper(false));

// What can only be read by scrolling it aside can be reached by keys.
function reachable() {
  for (const element of document.querySelectorAll(".wide, pre, nav")) {
    if (element.scrollWidth > element.clientWidth) element.tabIndex = 0;
    else element.removeAttribute("tabindex");
  }
}
window.addEventListener("resize", reachable);

// The section that is read is marked in the table of contents.
const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
const seen = new IntersectionObserver(
  (entries) => {
    for (const { target, isIntersecting } of entries) {
      if (!isIntersecting) continue;
      for (const link of links.values()) link.removeAttribute("aria-current");
      links.get(target.id)?.setAttribute("aria-current", "true");
    }
  },
  { rootMargin: "-60px 0px -70% 0px" },
);
document.querySelectorAll("main section").forEach((section) => seen.observe(section));

const table = document.getElementById("ranking");
const choice = document.getElementById("choice") && new Choice(beside);
if (table) ranking(table, beside, choice);
reachable();
beside?.follow();

// A link to a part that is folded unfolds it, and a chart in it takes its size.
for (const details of document.querySelectorAll("details")) {
  details.addEventListener("toggle", () => details.querySelectorAll(".js-plotly-plot").forEach((plot) => Plotly.Plots.resize(plot)));
}
for (const link of document.querySelectorAll("nav a")) {
  link.addEventListener("click", () => document.querySelector(`${link.hash} > details`)?.setAttribute("open", ""));
}
