// A view in a cell of a notebook: in the cell's theme, and with WebGL only while it is looked at.

const notebook = frameElement?.ownerDocument.body;
function follow() {
  const light = notebook?.dataset.jpThemeLight; // JupyterLab's
  if (light) document.documentElement.dataset.theme = light === "true" ? "light" : "dark";
}
follow();
const shown = new View(document.querySelector(".view"));
function redraw() {
  follow();
  shown.load();
}
prefersDark.addEventListener("change", redraw);
if (notebook) new MutationObserver(redraw).observe(notebook, { attributeFilter: ["data-jp-theme-light"] });
new IntersectionObserver((entries) => (entries.at(-1).isIntersecting ? shown.start() : shown.stop())).observe(shown.plot);
