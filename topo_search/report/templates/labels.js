// Labels over a 3-D view: each next to its point, with a leader line, and without overlaps.

const SVG = "http://www.w3.org/2000/svg";
const DISTANCES = [32, 44, 58, 74, 92, 112];
const DIRECTIONS = 16;
const AXES_ORIGIN = 42; // origin of the drawn axes, from the left and from the bottom [px]
const AXIS = 26; // length of an axis parallel to the screen [px]

class Labels {
  constructor(canvas) {
    this.marks = [];
    this.offsets = new Map(); // last offset of each label, kept while it is free
    this.layer = document.createElementNS(SVG, "svg");
    this.layer.classList.add("labels");
    this.layer.setAttribute("aria-hidden", "true");
    canvas.append(this.layer);
  }

  set(marks, cell) {
    this.marks = marks;
    const texts = [...marks.map(({ text }) => text), "x", "y", "z", `squares of ${cell} m`];
    this.layer.replaceChildren(
      ...texts.map((text) => {
        const group = document.createElementNS(SVG, "g");
        const line = document.createElementNS(SVG, "line");
        const words = document.createElementNS(SVG, "text");
        words.textContent = text;
        group.append(line, words);
        return group;
      }),
    );
    this.sizes = marks.map(({ text }) => ({ width: 7.6 * text.length + 6, height: 17 }));
  }

  // Draws the labels again after each frame of the view.
  draw(stage) {
    const { clientWidth: width, clientHeight: height } = stage.canvas;
    const frame = { width, height };
    const points = this.marks.map(({ at }) => stage.onScreen(at));
    const middle = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / (points.length || 1));
    const occupied = [{ left: 0, right: 2 * AXES_ORIGIN, top: frame.height - 2 * AXES_ORIGIN, bottom: frame.height }];
    this.marks.forEach(({ text }, m) => {
      const [position, box] = this.place(text, points[m], middle, this.sizes[m], points, occupied, frame);
      occupied.push(box);
      this.put(m, points[m], position, position);
    });
    const [corner, count] = [[AXES_ORIGIN, frame.height - AXES_ORIGIN], this.marks.length];
    stage.axes().forEach((axis, k) => {
      const [end, beyond] = [1, 1.4].map((times) => axis.map((x, side) => corner[side] + times * AXIS * x));
      this.put(count + k, corner, end, beyond);
    });
    this.put(count + 3, corner, corner, [corner[0] + 120, corner[1] + 28]);
  }

  // Sets the position of a label and of its line.
  put(number, from, to, [x, y]) {
    const [line, words] = this.layer.children[number].children;
    for (const [name, value] of Object.entries({ x1: from[0], y1: from[1], x2: to[0], y2: to[1] })) line.setAttribute(name, value);
    words.setAttribute("x", x);
    words.setAttribute("y", y);
  }

  // Returns position and box of a label at the first free offset from its point: the last one, then outwards, near before far.
  place(text, point, middle, size, points, occupied, frame) {
    const outwards = Math.atan2(point[1] - middle[1], point[0] - middle[0]);
    const candidates = [this.offsets.get(text), ...around(outwards)].filter(Boolean);
    let chosen = candidates[candidates.length - 1];
    for (const offset of candidates) {
      const box = boxAt(point, offset, size);
      const free =
        box.left > 0 && box.top > 0 && box.right < frame.width && box.bottom < frame.height &&
        !occupied.some((other) => box.left < other.right && other.left < box.right && box.top < other.bottom && other.top < box.bottom) &&
        !points.some(([x, y]) => box.left - 5 < x && x < box.right + 5 && box.top - 5 < y && y < box.bottom + 5);
      if (free) {
        chosen = offset;
        break;
      }
    }
    this.offsets.set(text, chosen);
    return [[point[0] + chosen[0], point[1] + chosen[1]], boxAt(point, chosen, size)];
  }
}

function* around(outwards) {
  for (const distance of DISTANCES) {
    for (let k = 0; k < DIRECTIONS; k++) {
      const turn = (k % 2 ? 1 : -1) * Math.ceil(k / 2) * ((2 * Math.PI) / DIRECTIONS);
      yield [distance * Math.cos(outwards + turn), distance * Math.sin(outwards + turn)];
    }
  }
}

function boxAt(point, offset, { width, height }) {
  const [x, y] = [point[0] + offset[0], point[1] + offset[1]];
  return { left: x - width / 2, right: x + width / 2, top: y - height / 2, bottom: y + height / 2 };
}
