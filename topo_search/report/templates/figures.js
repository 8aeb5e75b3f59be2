"use strict";

// Colours of the figures on a dark page, by those on a light one.
const DARK = {
  "#222222": "#e8eaed", "#000000": "#ffffff", "#262626": "#aeb4bd", "#dddddd": "#3d424b", "#bbbbbb": "#6b7280",
  "#EBF0F8": "#333842", "#0072b2": "#4aa8e0",
};
const dusk = matchMedia("(prefers-color-scheme: dark)");
let printing = false;

function dark() {
  const theme = document.documentElement.dataset.theme ?? (dusk.matches ? "dark" : "light");
  return theme === "dark" && !printing && CSS.supports("color", "light-dark(#000, #fff)");
}

// The JSON of a script element, in the colours of the page.
function read(id) {
  let text = document.getElementById(id).textContent;
  if (dark()) for (const [light, other] of Object.entries(DARK)) text = text.replaceAll(light, other);
  return JSON.parse(text);
}

function draw(plot, traces, layout) {
  const options = {
    responsive: true,
    displaylogo: false,
    displayModeBar: plot.closest(".matrix") ? false : undefined, // it would cover the colour bar
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
  };
  return Plotly.react(plot, traces, { ...read("look"), ...layout }, options);
}

// Every figure is drawn from the JSON that follows its element, again whenever the page turns dark or light.
function drawFigures() {
  for (const element of document.querySelectorAll("[data-figure]")) {
    const figure = read(element.dataset.figure);
    draw(element, figure.data, figure.layout);
  }
}
