// Labels over a view in 3-D: each beside what it names, with a line to it, none over another.

const SVG = "http://www.w3.org/2000/svg";
const DISTANCES = [32, 44, 58, 74, 92, 112];
const DIRECTIONS = 16;
const CORNER = 42; // of the axes, from the left and from below [px]
const AXIS = 26; // length of an axis that lies in the picture [px]

class Labels {
  constructor(canvas) {
    this.marks = [];
    this.places = new Map(); // where each label was last, so that it stays there while nothing is in its way
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

  // Draws the labels anew, as every picture of the view asks for.
  draw(stage) {
    const { clientWidth: width, clientHeight: height } = stage.canvas;
    const frame = { width, height };
    const points = this.marks.map(({ at }) => stage.onScreen(at));
    const middle = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / (points.length || 1));
    const taken = [{ left: 0, right: 2 * CORNER, top: frame.height - 2 * CORNER, bottom: frame.height }];
    this.marks.forEach(({ text }, m) => {
      const [place, box] = this.placed(text, points[m], middle, this.sizes[m], points, taken, frame);
      taken.push(box);
      this.put(m, points[m], place, place);
    });
    const [corner, count] = [[CORNER, frame.height - CORNER], this.marks.length];
    stage.axes().forEach((axis, k) => {
      const [end, beyond] = [1, 1.4].map((times) => axis.map((x, side) => corner[side] + times * AXIS * x));
      this.put(count + k, corner, end, beyond);
    });
    this.put(count + 3, corner, corner, [corner[0] + 120, corner[1] + 28]);
  }

  // Places a label with its line.
  put(number, from, to, [x, y]) {
    const [line, words] = this.layer.children[number].children;
    for (const [name, value] of Object.entries({ x1: from[0], y1: from[1], x2: to[0], y2: to[1] })) line.setAttribute(name, value);
    words.setAttribute("x", x);
    words.setAttribute("y", y);
  }

  // The first free place around a point: where the label was, else outwards from the middle, near before far.
  placed(text, point, middle, size, points, taken, frame) {
    const outwards = Math.atan2(point[1] - middle[1], point[0] - middle[0]);
    const tried = [this.places.get(text), ...around(outwards)].filter(Boolean);
    let chosen = tried[tried.length - 1];
    for (const offset of tried) {
      const box = boxed(point, offset, size);
      const free =
        box.left > 0 && box.top > 0 && box.right < frame.width && box.bottom < frame.height &&
        !taken.some((other) => box.left < other.right && other.left < box.right && box.top < other.bottom && other.top < box.bottom) &&
        !points.some(([x, y]) => box.left - 5 < x && x < box.right + 5 && box.top - 5 < y && y < box.bottom + 5);
      if (free) {
        chosen = offset;
        break;
      }
    }
    this.places.set(text, chosen);
    return [[point[0] + chosen[0], point[1] + chosen[1]], boxed(point, chosen, size)];
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

function boxed(point, offset, { width, height }) {
  const [x, y] = [point[0] + offset[0], point[1] + offset[1]];
  return { left: x - width / 2, right: x + width / 2, top: y - height / 2, bottom: y + height / 2 };
}
