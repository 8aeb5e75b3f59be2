"use strict";

// Colours of the figures in the dark theme, by the colour in the light theme.
const DARK = {
  "#222222": "#e8eaed", "#000000": "#ffffff", "#262626": "#aeb4bd", "#dddddd": "#3d424b", "#bbbbbb": "#6b7280",
  "#EBF0F8": "#333842", "#0072b2": "#4aa8e0",
};
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
let printing = false;

function dark() {
  const theme = document.documentElement.dataset.theme ?? (prefersDark.matches ? "dark" : "light");
  return theme === "dark" && !printing && CSS.supports("color", "light-dark(#000, #fff)");
}

// Returns the JSON of a script element, with the colours of the current theme.
function read(id) {
  let text = document.getElementById(id).textContent;
  if (dark()) for (const [light, darkened] of Object.entries(DARK)) text = text.replaceAll(light, darkened);
  return JSON.parse(text);
}

function draw(plot, traces, layout) {
  const options = {
    responsive: true,
    displaylogo: false,
    displayModeBar: plot.closest(".matrix") ? false : undefined, // it would cover a matrix
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
  };
  return Plotly.react(plot, traces, { ...read("look"), ...layout }, options);
}

// Draws every figure from the JSON that follows its element; called again when the theme changes.
function drawFigures() {
  for (const element of document.querySelectorAll("[data-figure]")) {
    const figure = read(element.dataset.figure);
    draw(element, figure.data, figure.layout);
  }
}
