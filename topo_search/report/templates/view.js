// A design in 3-D: what is shown of it is chosen by buttons, modules are labelled without pile-ups.

// What a choice draws besides the platform itself, and how faintly.
const CHOICES = {
  platform: { airflow: 0.06, regions: 0.4 },
  airflow: { airflow: 0.22, regions: 0.4, cones: 0.15, closest: 1 },
  everything: { airflow: 0.22, regions: 0.4, cones: 0.15, closest: 1, connectors: 1 },
  case: { regions: 0.4 },
  forces: {},
  assembly: {},
};
const ALWAYS = ["modules", "rotors", "axes", "joints", "tip", "rod"];
const AT_THE_END = ["tip", "rod"]; // of an assembly
const TOLD = ["modules", "rotors", "airflow"]; // by the pointer: airflow lies around its module
const UNFRAMED = ["airflow", "cones", "closest"]; // fade out of a picture of the platform
const POINTS = { axes: 3, joints: 4 }; // that a line of these has with the gap after it
const THROTTLE = [[0, "#f0f0f0"], [0.5, "#f2b779"], [1, "#c8401c"]];
const MARGIN = 0.08;
const ROOM = { x: 1.4, y: 1.4, z: 2.4 }; // for air, over the size of what else is drawn
const PAPER = 640; // width of a picture on paper [px]

function numbers(values) {
  // as Plotly writes an array of single precision
  if (!values || values.bdata === undefined) return values;
  return new Float32Array(Uint8Array.from(atob(values.bdata), (c) => c.charCodeAt(0)).buffer);
}

// The copies of a mesh in the frames of the first modules.
function copies(mesh, view, count) {
  const m = mesh.x.length;
  const found = { x: [], y: [], z: [], i: [], j: [], k: [] };
  for (let c = 0; c < count; c++) {
    const [R, p] = [view.R[c], view.p[c]];
    for (let v = 0; v < m; v++) {
      const [x, y, z] = [mesh.x[v], mesh.y[v], mesh.z[v]];
      found.x.push(p[0] + R[0][0] * x + R[0][1] * y + R[0][2] * z);
      found.y.push(p[1] + R[1][0] * x + R[1][1] * y + R[1][2] * z);
      found.z.push(p[2] + R[2][0] * x + R[2][1] * y + R[2][2] * z);
    }
    for (const name of "ijk") for (const corner of mesh[name]) found[name].push(corner + c * m);
  }
  return found;
}

function extent(traces) {
  const box = { x: [Infinity, -Infinity], y: [Infinity, -Infinity], z: [Infinity, -Infinity] };
  for (const trace of traces) {
    for (const axis of "xyz") {
      for (const value of trace[axis]) {
        if (Number.isNaN(value) || value === null) continue;
        box[axis][0] = Math.min(box[axis][0], value);
        box[axis][1] = Math.max(box[axis][1], value);
      }
    }
  }
  const aside = MARGIN * Math.max(...Object.values(box).map(([low, high]) => high - low));
  for (const axis of "xyz") box[axis] = [box[axis][0] - aside, box[axis][1] + aside];
  return box;
}

// Frames a scene so that a box has its true proportions and one size, whatever room there is about its middle.
// Returns the room, from which nothing above the box is kept: jets blow down.
function frame(scene, box, times) {
  const size = Math.cbrt(Object.values(box).reduce((volume, [low, high]) => volume * (high - low), 1));
  const room = {};
  Object.assign(scene, { aspectmode: "manual", aspectratio: {} });
  for (const [axis, [low, high]] of Object.entries(box)) {
    const aside = ((times[axis] - 1) * (high - low)) / 2;
    scene[`${axis}axis`].range = [low - aside, high + aside];
    scene.aspectratio[axis] = (times[axis] * (high - low)) / size;
    room[axis] = [low - aside, axis === "z" ? high : high + aside];
  }
  return room;
}

class View {
  constructor(element) {
    this.element = element;
    this.plot = element.querySelector(".plot");
    this.told = element.querySelector(".told");
    this.choice = { kind: "platform", number: 0 };
    this.air = { speed: 0, across: "", at: null }; // a surface [m/s] and a slice, at a position [m] or through the tip
    this.beside = null; // the view that shows and turns the same
    this.labels = new Labels(this.plot);
    for (const button of element.querySelectorAll("[data-choice]")) {
      button.addEventListener("click", () => this.choose(button.dataset.choice, Number(button.dataset.number ?? 0)));
    }
    const list = element.querySelector("[data-cases]");
    list?.addEventListener("change", () => list.value && this.choose("case", Number(list.value)));
    for (const button of element.querySelectorAll("[data-step]")) {
      button.addEventListener("click", () => this.step(Number(button.dataset.step)));
    }
    for (const input of element.querySelectorAll("[data-air]")) {
      input.addEventListener("change", () => this.blow(input.dataset.air, input.value));
    }
    this.plot.addEventListener("keydown", (event) => this.turn(event));
    this.load();
  }

  // Reads what there is to draw, in the colours of the page, and draws it.
  load() {
    this.value = read(this.plot.dataset.view);
    this.meshes = this.value.meshes ?? read("meshes");
    const traces = [this.value.data, ...Object.values(this.extras())].flatMap((traces) => traces ?? []);
    for (const [number, trace] of traces.entries()) {
      trace.uid = `trace-${number}`;
      for (const axis of "xyz") trace[axis] = numbers(trace[axis]);
    }
    return this.show();
  }

  choose(kind, number, air = this.air) {
    this.beside?.set(kind, number, air);
    return this.set(kind, number, air);
  }

  // Shows the air in the load case that is shown, or in the first.
  blow(name, value) {
    const at = name === "across" ? { at: null } : {};
    const air = { ...this.air, ...at, [name]: name === "across" ? value : Number(value) };
    return this.choose("case", this.choice.kind === "case" ? this.choice.number : 0, air);
  }

  set(kind, number, air) {
    this.air = air;
    const last = (kind === "assembly" ? this.value.steps : this.value.cases).length - 1;
    this.choice = { kind, number: Math.max(0, Math.min(last, number)) };
    return this.show();
  }

  // Two views that show the same of two designs, from the same side.
  pair(other) {
    Plotly.relayout(other.plot, { "scene.camera": structuredClone(this.plot.layout.scene.camera) });
    for (const [one, two] of [[this, other], [other, this]]) {
      one.beside = two;
      one.plot.on?.("plotly_relayout", (change) => {
        const camera = change["scene.camera"];
        if (!camera || one.following) return;
        two.following = true;
        Plotly.relayout(two.plot, { "scene.camera": camera }).finally(() => (two.following = false));
      });
    }
  }

  remove() {
    this.beside = null;
    Plotly.purge(this.plot);
  }

  step(by) {
    return this.choose("assembly", this.choice.number + by);
  }

  // What is drawn of a choice; of an assembly, what is there after a step.
  traces({ kind, number }) {
    const { value } = this;
    const n = value.p.length;
    const building = kind === "assembly";
    const count = building ? Math.min(number + 1, n) : n;
    const shown = [];
    for (const trace of value.data) {
      const { part, mesh } = trace.meta;
      const strength = ALWAYS.includes(part) ? 1 : CHOICES[kind][part];
      if (strength === undefined || (building && number < n && AT_THE_END.includes(part))) continue;
      const drawn = { ...trace };
      if (mesh) Object.assign(drawn, copies(this.meshes[mesh], value, count));
      else if (building && POINTS[part]) {
        const points = POINTS[part] * (part === "joints" ? count - 1 : count);
        for (const axis of "xyz") drawn[axis] = trace[axis].slice(0, points);
      }
      if (part === "airflow" || part === "regions" || part === "cones") drawn.opacity = strength;
      if (TOLD.includes(part)) this.tell(drawn, part, count, kind === "case" ? number : null);
      shown.push(drawn);
    }
    return [...shown, ...this.extras()[kind === "case" ? `case ${number}` : kind] ?? []];
  }

  // What only one choice draws.
  extras() {
    const { cases, forces } = this.value;
    return { ...Object.fromEntries(cases.map((one, k) => [`case ${k}`, one.traces])), forces: forces?.traces };
  }

  // Gives every corner its module's numbers for the pointer; rotors in a load case have the colour of their throttle.
  // They are a trace of their own: a mesh that Plotly has once given a scale of colours keeps it.
  tell(trace, part, count, number) {
    const corners = this.meshes[part].x.length;
    const { modules, throttle } = this.value;
    const texts = modules.slice(0, count).map((text, c) => text + this.throttles(c, number));
    trace.text = texts.flatMap((text) => Array(corners).fill(text));
    trace.hoverinfo = "text";
    if (part !== "rotors" || number === null) return;
    trace.intensity = [];
    for (let c = 0; c < count; c++) {
      for (const u of throttle[number][c]) for (let v = 0; v < corners / 4; v++) trace.intensity.push(100 * u);
    }
    const bar = { title: { text: "throttle [%]" }, len: 0.6, y: 0.45, thickness: 12, outlinewidth: 0 };
    Object.assign(trace, { uid: "throttle", cmin: 0, cmax: 100, colorscale: THROTTLE, showscale: true, colorbar: bar });
  }

  // The throttles of a module's rotors: of one load case each, of all how far they go.
  throttles(c, number) {
    return this.value.throttle
      .map((of, k) => {
        if (number !== null && k !== number) return "";
        const u = of[c].map((share) => (100 * share).toFixed(1));
        return `<br>load case ${k}: throttle ${u.join(", ")} %`;
      })
      .slice(0, number === null ? 4 : undefined)
      .join("");
  }

  show() {
    const { kind, number } = this.choice;
    const { value } = this;
    const traces = this.traces(this.choice);
    const near = kind !== "airflow" && kind !== "everything";
    const all = kind === "assembly" ? this.traces({ kind, number: value.p.length }) : traces;
    const others = kind === "case" ? value.cases.flatMap((one) => one.traces) : [];
    const framed = [...all, ...others].filter((trace) => !near || !UNFRAMED.includes(trace.meta.part));
    const box = extent(framed);
    const { speed, across } = this.air;
    const air = kind === "case" && Boolean(speed || across);
    const layout = structuredClone(value.layout);
    const room = frame(layout.scene, box, air ? ROOM : { x: 1, y: 1, z: 1 });
    layout.scene.uirevision = "kept"; // the camera stays where the reader turned it
    this.labels.set(this.marks(near));
    for (const button of this.element.querySelectorAll("[data-choice]")) {
      const same = button.dataset.choice === kind && (kind !== "case" || Number(button.dataset.number) === number);
      button.setAttribute("aria-pressed", same);
    }
    const list = this.element.querySelector("[data-cases]");
    if (list) list.value = kind === "case" ? number : "";
    for (const [name, value] of Object.entries({ speed, across })) this.element.querySelector(`[data-air=${name}]`).value = value;
    this.element.querySelector("[data-air=at]").parentElement.hidden = !across;
    if (air) traces.push(...this.blown(number, room));
    this.element.querySelector(".steps").hidden = kind !== "assembly";
    this.told.textContent = this.words();
    return draw(this.plot, traces, layout).then(() => this.labels.follow());
  }

  // What is drawn of the air of a load case within a box.
  blown(number, box) {
    const { speed, across } = this.air;
    const air = new Air(this.value, number);
    const traces = speed ? [air.surface(speed, box)] : [];
    if (!across) return traces;
    const [[, tip]] = this.value.marks;
    const at = this.air.at ?? tip["xyz".indexOf(across)];
    const slider = this.element.querySelector("[data-air=at]");
    [slider.min, slider.max] = box[across];
    slider.value = at;
    const through = this.air.at === null ? ", through the tip" : "";
    slider.nextElementSibling.textContent = `${across} = ${(Math.round(100 * at) / 100 + 0).toFixed(2)} m${through}`;
    return [...traces, air.slice(across, at, box)];
  }

  words() {
    const { kind, number } = this.choice;
    const { cases, steps } = this.value;
    if (kind === "case") {
      const air = this.air.speed || this.air.across ? " Air by the jet model, cut off around the platform." : "";
      return `${cases[number].name}: ${cases[number].told}. The rotors have the colour of their throttle.${air}`;
    }
    if (kind === "forces") return this.value.forces.told;
    if (kind === "assembly") return `Step ${number + 1} of ${steps.length}: ${steps[number]}`;
    const pair = this.value.data.find((trace) => trace.meta.part === "closest");
    if (kind === "platform") return "The airflow is faded and cut off around the platform.";
    return pair ? `The ${pair.name}.` : "";
  }

  // Labels and what they point at.
  marks(near) {
    const { kind, number } = this.choice;
    const { p, marks, numbered, cases } = this.value;
    const count = kind === "assembly" ? Math.min(number + 1, p.length) : p.length;
    const found = numbered ? p.slice(0, count).map((at, i) => ({ text: String(i), at })) : [];
    if (near && (kind !== "assembly" || number >= p.length)) for (const [text, at] of marks) found.push({ text, at });
    if (kind === "case") for (const [text, at] of cases[number].ends) found.push({ text, at });
    return found;
  }

  // Paper keeps nothing of a canvas of WebGL: a still picture takes its place, as wide as the paper.
  paper(is) {
    const [scene, canvas] = [this.plot._fullLayout?.scene?._scene, this.element.querySelector(".canvas")];
    this.still?.remove();
    canvas.style.width = canvas.style.zoom = "";
    if (!is || !scene?.glplot?.cameraParams) return;
    this.still = new Image();
    this.still.className = "still";
    this.still.alt = "";
    this.still.src = scene.toImage("png");
    scene.container.append(this.still);
    const width = canvas.offsetWidth;
    canvas.style.width = `${width}px`;
    canvas.style.zoom = PAPER / width;
  }

  // The arrow keys turn the view, plus and minus come closer and go away.
  turn(event) {
    const scene = this.plot._fullLayout?.scene?._scene;
    const steps = { ArrowLeft: [-1, 0, 1], ArrowRight: [1, 0, 1], ArrowUp: [0, 1, 1], ArrowDown: [0, -1, 1] };
    const step = { ...steps, "+": [0, 0, 0.9], "-": [0, 0, 1 / 0.9] }[event.key];
    if (!scene?.getCamera || !step) return;
    event.preventDefault();
    const camera = scene.getCamera();
    const { x, y, z } = camera.eye;
    const far = Math.hypot(x, y, z) * step[2];
    const across = Math.atan2(y, x) + 0.12 * step[0];
    const up = Math.max(-1.5, Math.min(1.5, Math.asin(z / Math.hypot(x, y, z)) + 0.12 * step[1]));
    const eye = { x: far * Math.cos(up) * Math.cos(across), y: far * Math.cos(up) * Math.sin(across), z: far * Math.sin(up) };
    Plotly.relayout(this.plot, { "scene.camera": { ...camera, eye } });
  }
}
