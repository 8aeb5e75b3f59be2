// The 3-D view of a design; buttons choose what it shows, and labels name modules without overlaps.

// Kinds of parts that are hidden at first; a click on the name shows them.
const HIDDEN_AT_FIRST = ["airflow", "cones", "closest", "connectors", "offset"];
const FRAMED = ["modules", "rotors", "axes", "joints", "rod", "tip", "case", "contact", "forces"]; // the view is fitted to these
const WITH_TOOLTIP = ["modules", "rotors", "airflow"]; // airflow encloses its module
const UNSHADED = ["airflow", "cones", "regions", "walls", "violated", "forces", "contact"]; // kinds that cast no shadow
const STAYS = ["regions", "walls", "solids", "cones"]; // kinds that do not fly along
const THROTTLE = ["#f0f0f0", "#f2b779", "#c8401c"]; // at 0, 50 and 100 %
const ROOM = [1.4, 1.4, 2.4]; // box of the air, over the size of the framed points
const PAPER = 640; // width of a printed picture [px]

class View {
  constructor(element) {
    this.element = element;
    this.plot = element.querySelector(".stage");
    this.description = element.querySelector(".description");
    this.legend = element.querySelector(".legend");
    this.choice = { kind: "platform", number: 0 };
    this.air = { speed: 0, across: "", at: null }; // speed of the surface [m/s]; axis and position [m] of the slice, null: through the tip
    this.hidden = new Set(HIDDEN_AT_FIRST); // kinds of parts that are not shown
    this.linked = null; // the view that shows the same and turns along
    for (const button of element.querySelectorAll("[data-choice]")) {
      button.addEventListener("click", () => this.choose({ kind: button.dataset.choice, number: Number(button.dataset.number ?? 0) }));
    }
    const list = element.querySelector("[data-cases]");
    list?.addEventListener("change", () => list.value && this.choose({ kind: "case", number: Number(list.value) }));
    for (const button of element.querySelectorAll("[data-step]")) {
      button.addEventListener("click", () => this.choose({ kind: "assembly", number: this.choice.number + Number(button.dataset.step) }));
    }
    for (const input of element.querySelectorAll("[data-air]")) {
      input.addEventListener("change", () => this.showAir(input.dataset.air, input.value));
    }
    element.querySelector("[data-flights]")?.addEventListener("change", ({ target }) => target.value && this.fly(Number(target.value)));
    element.querySelector("[data-play]")?.addEventListener("click", () => this.play());
    this.slider = element.querySelector("[data-time]");
    this.slider?.addEventListener("input", () => this.seek(Number(this.slider.value)));
    this.plot.addEventListener("keydown", (event) => this.stage?.key(event));
    this.labels = new Labels(this.plot.parentElement);
    this.start();
  }

  // Starts WebGL, of which a browser gives about 16 views a context at a time.
  start() {
    if (this.stage) return;
    this.value = read(this.plot.dataset.view);
    try {
      this.stage = new Stage(this.plot, this.value.towards, (orbit) => this.linked?.turn(orbit));
    } catch {
      this.stage = null; // the still picture remains
    }
    if (this.stage) this.listen();
    this.load();
  }

  // Gives the context back, and leaves a picture.
  stop() {
    if (!this.stage) return;
    this.pause();
    this.orbit = this.stage.orbit;
    this.stage.picture();
    const picture = Object.assign(new Image(), { className: "still", alt: "", src: this.stage.canvas.toDataURL() });
    this.stage.remove();
    this.stage = null;
    this.plot.replaceChildren(picture);
  }

  listen() {
    const { stage, plot } = this;
    stage.orbit = this.orbit ?? stage.orbit;
    stage.drawn = () => this.labels.draw(stage);
    const hover = this.element.querySelector(".hover");
    stage.canvas.addEventListener("pointermove", (event) => {
      const hit = event.buttons ? undefined : stage.under(event);
      hover.hidden = !hit;
      if (!hit) return;
      hover.textContent = hit.object.userData.tooltip(hit);
      hover.style.left = `${Math.min(event.offsetX + 14, plot.clientWidth - hover.offsetWidth)}px`;
      hover.style.top = `${Math.min(event.offsetY + 14, plot.clientHeight - hover.offsetHeight)}px`;
    });
    stage.canvas.addEventListener("pointerleave", () => (hover.hidden = true));
  }

  // Reads the data in the colours of the page, and draws it.
  load() {
    this.value = read(this.plot.dataset.view);
    this.meshes = this.value.meshes ?? read("meshes");
    this.show();
  }

  choose(choice, air = this.air, hidden = this.hidden) {
    this.linked?.set(choice, air, hidden);
    this.set(choice, air, hidden);
  }

  // Shows the air in the current load case, or in the first.
  showAir(name, value) {
    const at = name === "across" ? { at: null } : {};
    const air = { ...this.air, ...at, [name]: name === "across" ? value : Number(value) };
    this.choose(this.choice.kind === "case" ? this.choice : { kind: "case", number: 0 }, air);
  }

  // Shows a flight from its start, and plays it.
  fly(number) {
    this.pause();
    this.time = 0;
    this.choose({ kind: "flight", number });
    this.play();
  }

  // Plays the flight that is shown, or pauses; from the start if it is at its end.
  play() {
    if (this.playing) return this.pause();
    const { rows } = this.value.flights[this.choice.number];
    const end = rows.at(-1)[0];
    if (this.time >= end) this.time = 0;
    this.element.querySelector("[data-play]").textContent = "Pause";
    let last; // time of the frame before
    const step = (now) => {
      this.playing = this.time < end ? requestAnimationFrame(step) : this.pause();
      this.seek(Math.min(end, this.time + (now - (last ?? now)) / 1000));
      last = now;
    };
    this.playing = requestAnimationFrame(step);
  }

  pause() {
    cancelAnimationFrame(this.playing);
    this.playing = undefined;
    const button = this.element.querySelector("[data-play]");
    if (button) button.textContent = "Play";
  }

  // Moves the platform to where it is at a time of the flight [s].
  seek(time) {
    this.time = time;
    const { rows } = this.value.flights[this.choice.number];
    const before = rows.findLastIndex(([at]) => at <= time);
    const [a, b] = [rows[before], rows[before + 1] ?? rows[before]];
    const share = (time - a[0]) / (b[0] - a[0] || 1);
    const [, x, y, z, , , , away, tilt, input] = a.map((value, k) => value + share * (b[k] - value));
    const [from, to] = [a, b].map(([, , , , i, j, k]) => new THREE.Quaternion(i, j, k, Math.sqrt(Math.max(0, 1 - i * i - j * j - k * k))));
    const centre = new THREE.Vector3(...this.value.marks[1][1]); // of mass
    this.motion = new THREE.Matrix4().compose(centre.clone().add({ x, y, z }), from.slerp(to, share), new THREE.Vector3(1, 1, 1));
    this.motion.multiply(new THREE.Matrix4().makeTranslation(...centre.negate().toArray()));
    this.slider.max = rows.at(-1)[0];
    this.slider.value = time;
    const numbers = `${time.toFixed(2)} s: ${away.toFixed(1)} cm off, ${tilt.toFixed(1)}° tilted, largest input ${input.toFixed(0)} %`;
    this.element.querySelector(".readout").textContent = numbers;
    this.move();
  }

  // Puts what flies along in its place.
  move() {
    if (!this.stage) return;
    for (const object of this.stage.content.children) {
      if (STAYS.includes(object.name)) continue;
      Object.assign(object, { matrixAutoUpdate: false, matrixWorldNeedsUpdate: true });
      object.matrix.copy(this.motion);
    }
    this.labels.marks = this.marks().map(({ text, at }) => ({ text, at: new THREE.Vector3(...at).applyMatrix4(this.motion).toArray() }));
    this.stage.render();
  }

  // Hides a kind of part, or shows it again.
  toggle(kind) {
    const hidden = new Set(this.hidden);
    if (!hidden.delete(kind)) hidden.add(kind);
    this.choose(this.choice, this.air, hidden);
  }

  set({ kind, number }, air, hidden) {
    Object.assign(this, { air, hidden });
    const last = (kind === "assembly" ? this.value.steps : kind === "flight" ? this.value.flights : this.value.cases).length - 1;
    if (kind !== "flight") this.pause();
    this.choice = { kind, number: Math.max(0, Math.min(last, number)) };
    this.show();
  }

  // Links two views: they show the same of two designs from the same viewpoint.
  pair(other) {
    this.linked = other;
    other.linked = this;
    other.turn(this.stage?.orbit);
  }

  turn(orbit) {
    if (!this.stage) return;
    this.stage.orbit = orbit;
    this.stage.render();
  }

  remove() {
    this.linked = null;
    this.pause();
    this.stage?.remove();
  }

  // Returns the parts of a choice, including hidden ones.
  parts({ kind, number } = this.choice) {
    const { parts, cases, forces } = this.value;
    return [...parts, ...(kind === "case" ? cases[number].parts : []), ...(kind === "forces" ? forces.parts : [])];
  }

  // Returns an object with the copies of a part that are mounted after a step of the assembly.
  object(part, last = Infinity) {
    const shown = part.steps.map((_, k) => k).filter((k) => part.steps[k] <= last);
    const mesh = typeof part.mesh === "string" ? this.meshes[part.mesh] : part.mesh;
    const object = new THREE.InstancedMesh(surface(mesh), paint(part.colour, part.opacity), shown.length);
    shown.forEach((k, copy) => object.setMatrixAt(copy, this.pose(part.modules[k])));
    object.name = part.kind;
    object.userData = { part, modules: shown.map((k) => part.modules[k]) };
    object.castShadow = !UNSHADED.includes(part.kind);
    object.receiveShadow = part.opacity === 1 || part.kind === "walls";
    return object;
  }

  pose(module) {
    if (module === undefined) return new THREE.Matrix4();
    const [R, p] = [this.value.R[module], this.value.p[module]];
    return new THREE.Matrix4().set(...R.flatMap((row, axis) => [...row, p[axis]]), 0, 0, 0, 1);
  }

  // Adds the tooltips of all copies; in a load case, rotors get the colour of their throttle.
  addTooltips(object, number) {
    const { part, modules } = object.userData;
    const { throttle } = this.value;
    object.userData.tooltip = ({ instanceId }) => this.value.modules[modules[instanceId]] + this.throttles(modules[instanceId], number);
    if (part.kind !== "rotors" || number === null) return;
    const rotor = Number(part.mesh.split(" ")[1]);
    Object.assign(object.material, { opacity: 1, transparent: false, depthWrite: true }); // for true colours
    object.material.color.set("#ffffff");
    modules.forEach((module, copy) => object.setColorAt(copy, heat(throttle[number][module][rotor])));
  }

  // Returns the throttles of a module's rotors in one load case, or in the first four.
  throttles(module, number) {
    return this.value.throttle
      .map((byModule, k) => {
        if (number !== null && k !== number) return "";
        const u = byModule[module].map((share) => (100 * share).toFixed(1));
        if (!u.length) return "";
        return `\nload case ${k}: throttle ${u.join(", ")} %`;
      })
      .slice(0, number === null ? 4 : undefined)
      .join("");
  }

  show() {
    const { kind, number } = this.choice;
    this.description.textContent = this.words();
    for (const button of this.element.querySelectorAll("[data-choice]")) {
      const same = button.dataset.choice === kind && (kind !== "case" || Number(button.dataset.number) === number);
      button.setAttribute("aria-pressed", same);
    }
    const list = this.element.querySelector("[data-cases]");
    if (list) list.value = kind === "case" ? number : "";
    const { speed, across } = this.air;
    for (const [name, value] of Object.entries({ speed, across })) this.element.querySelector(`[data-air=${name}]`).value = value;
    this.element.querySelector("[data-air=at]").parentElement.hidden = !across;
    this.element.querySelector(".steps").hidden = kind !== "assembly";
    if (this.slider) {
      this.slider.parentElement.hidden = kind !== "flight";
      this.element.querySelector("[data-flights]").value = kind === "flight" ? number : "";
    }
    if (!this.stage) return;
    const { content } = this.stage;
    this.stage.clear(content);
    for (const part of this.parts()) {
      if (this.hidden.has(part.kind)) continue;
      const object = this.object(part, kind === "assembly" ? number : Infinity);
      if (WITH_TOOLTIP.includes(part.kind)) this.addTooltips(object, kind === "case" ? number : null);
      content.add(object);
    }
    const points = this.framed();
    this.stage.frame(points);
    if (kind === "case" && (speed || across)) content.add(...this.airObjects(number, points));
    this.labels.set(this.marks(), this.stage.cell);
    this.fillLegend();
    if (kind === "flight") this.seek(this.time);
    else this.stage.render();
  }

  // Returns the corners of the boxes to fit the view to; the same for all load cases and assembly steps.
  framed() {
    const cases = this.choice.kind === "case" ? this.value.cases.flatMap((loadCase) => loadCase.parts) : [];
    const framed = [...this.parts(), ...cases].filter((part) => FRAMED.includes(part.kind));
    const points = framed.flatMap((part) => {
      const { corners } = typeof part.mesh === "string" ? this.meshes[part.mesh] : part.mesh;
      const { min, max } = new THREE.Box3().setFromArray(corners);
      const ends = [min, max];
      const all = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => new THREE.Vector3(ends[k & 1].x, ends[(k >> 1) & 1].y, ends[k >> 2].z));
      return part.steps.flatMap((_, k) => all.map((corner) => corner.clone().applyMatrix4(this.pose(part.modules[k]))));
    });
    if (this.choice.kind !== "flight") return points;
    const way = new THREE.Box3().setFromPoints(this.value.flights[this.choice.number].rows.map(([, ...at]) => new THREE.Vector3(...at)));
    return [way.min, way.max].flatMap((aside) => points.map((point) => point.clone().add(aside)));
  }

  // Fills the legend: buttons that hide or show parts, and colour scales.
  fillLegend() {
    const { kind } = this.choice;
    const named = new Map(this.parts().map((part) => [part.name, part]));
    const buttons = [...named.values()].map((part) => {
      const button = document.createElement("button");
      button.type = "button";
      button.dataset.part = part.kind;
      button.setAttribute("aria-pressed", !this.hidden.has(part.kind));
      button.append(swatch(part.colour), part.name);
      button.addEventListener("click", () => {
        this.toggle(part.kind);
        this.legend.querySelector(`[data-part="${part.kind}"]`).focus();
      });
      return button;
    });
    const scales = [];
    if (kind === "case") scales.push(scale("throttle", THROTTLE, ["0", "50", "100 %"]));
    if (kind === "case" && this.air.across) scales.push(scale("air from", BANDS, BANDS.map((_, k) => (k ? `${2 ** (SLOWEST + k)}` : "0"))));
    this.legend.replaceChildren(...buttons, ...scales);
  }

  // Returns the objects of the air in a load case, around and below the framed points, because jets blow down.
  airObjects(number, points) {
    const { speed, across } = this.air;
    const { min, max } = new THREE.Box3().setFromPoints(points);
    const [low, high] = [min.toArray(), max.toArray()];
    const box = ROOM.map((times, axis) => {
      const aside = ((times - 1) * (high[axis] - low[axis])) / 2;
      return [low[axis] - aside, axis === 2 ? high[axis] : high[axis] + aside];
    });
    const air = new Air(this.value, number);
    const drawn = speed ? [air.surface(speed, box)] : [];
    if (!across) return drawn;
    const axis = "xyz".indexOf(across);
    const at = this.air.at ?? this.value.marks[0][1][axis];
    const slider = this.element.querySelector("[data-air=at]");
    [slider.min, slider.max] = box[axis];
    slider.value = at;
    const through = this.air.at === null ? ", through the tip" : "";
    slider.nextElementSibling.textContent = `${across} = ${(Math.round(100 * at) / 100 + 0).toFixed(2)} m${through}`;
    return [...drawn, air.slice(axis, at, box)];
  }

  words() {
    const { kind, number } = this.choice;
    const { cases, steps } = this.value;
    if (kind === "case") {
      const air = this.air.speed || this.air.across ? " Air by the jet model, cut off at a box around the platform." : "";
      return `${cases[number].name}: ${cases[number].description}. Rotors are coloured by throttle.${air}`;
    }
    if (kind === "forces") return this.value.forces.description;
    if (kind === "flight") return `${this.value.flights[number].name}, in simulation: ${this.value.flights[number].outcome}.`;
    if (kind === "assembly") return `Step ${number + 1} of ${steps.length}: ${steps[number]}`;
    return this.value.closest ?? "";
  }

  // Returns the labels and their points.
  marks() {
    const { kind, number } = this.choice;
    const { p, marks, numbered, cases } = this.value;
    const count = kind === "assembly" ? Math.min(number + 1, p.length) : p.length;
    const labels = numbered ? p.slice(0, count).map((at, i) => ({ text: String(i), at })) : [];
    if (kind !== "assembly" || number >= p.length) for (const [text, at] of marks) labels.push({ text, at });
    if (kind === "case") for (const [text, at] of cases[number].labels) labels.push({ text, at });
    return labels;
  }

  // A WebGL canvas does not print: replaces it by a still picture as wide as the paper.
  setPrinting(on) {
    const canvas = this.element.querySelector(".canvas");
    this.still?.remove();
    canvas.style.width = canvas.style.zoom = "";
    if (!on || !this.stage) return;
    this.stage.picture();
    this.still = new Image();
    this.still.className = "still";
    this.still.alt = "";
    this.still.src = this.stage.canvas.toDataURL();
    this.plot.append(this.still);
    const width = canvas.offsetWidth;
    canvas.style.width = `${width}px`;
    canvas.style.zoom = PAPER / width;
  }
}

// Returns the colour of a rotor by its throttle.
function heat(share) {
  const [low, middle, high] = THROTTLE.map((colour) => new THREE.Color(colour));
  return share < 0.5 ? low.lerp(middle, 2 * share) : middle.lerp(high, 2 * share - 1);
}

function swatch(colour) {
  const made = document.createElement("span");
  made.className = "swatch";
  made.style.background = colour;
  return made;
}

function scale(title, colours, texts) {
  const made = document.createElement("span");
  made.className = "scale";
  made.append(`${title} `, ...colours.flatMap((colour, k) => [swatch(colour), ` ${texts[k]} `]));
  return made;
}
