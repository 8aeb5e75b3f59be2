// Labels over a view in 3-D: each beside what it names, with a line to it, none over another.

const SVG = "http://www.w3.org/2000/svg";
const DISTANCES = [32, 44, 58, 74, 92, 112];
const DIRECTIONS = 16;

class Labels {
  constructor(plot) {
    this.plot = plot;
    this.marks = [];
    this.places = new Map(); // where each label was last, so that it stays there while nothing is in its way
    this.layer = document.createElementNS(SVG, "svg");
    this.layer.classList.add("labels");
    this.layer.setAttribute("aria-hidden", "true");
    plot.parentElement.append(this.layer);
  }

  set(marks) {
    this.marks = marks;
    this.layer.replaceChildren(
      ...marks.map(({ text }) => {
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

  // Draws the labels anew with every picture of the view; without WebGL there is none.
  follow() {
    const scene = this.plot._fullLayout?.scene?._scene;
    if (!scene?.glplot?.cameraParams) {
      this.layer.replaceChildren();
      return;
    }
    if (scene.glplot !== this.followed) {
      this.followed = scene.glplot;
      const before = this.followed.onrender;
      this.followed.onrender = () => {
        before();
        this.draw(scene);
      };
    }
    this.draw(scene);
  }

  draw(scene) {
    const [frame, inside] = [this.layer.getBoundingClientRect(), scene.container.getBoundingClientRect()];
    const points = this.marks.map(({ at }) => {
      const [x, y] = onScreen(scene, at);
      return [inside.left - frame.left + x * inside.width, inside.top - frame.top + y * inside.height];
    });
    const middle = [0, 1].map((axis) => points.reduce((sum, point) => sum + point[axis], 0) / (points.length || 1));
    const taken = [];
    this.marks.forEach(({ text }, m) => {
      const [place, box] = this.placed(text, points[m], middle, this.sizes[m], points, taken, frame);
      taken.push(box);
      const [line, words] = this.layer.children[m].children;
      const [x, y] = points[m];
      for (const [name, value] of Object.entries({ x1: x, y1: y, x2: place[0], y2: place[1] })) line.setAttribute(name, value);
      words.setAttribute("x", place[0]);
      words.setAttribute("y", place[1]);
    });
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

// Where a point of the data lies in the picture, in shares of its width and height.
function onScreen(scene, at) {
  const { model, view, projection } = scene.glplot.cameraParams;
  const turned = (m, v) => [0, 1, 2, 3].map((j) => v.reduce((sum, x, i) => sum + m[4 * i + j] * x, 0));
  const scaled = [...at.map((x, axis) => x * scene.dataScale[axis]), 1];
  const [x, y, , w] = turned(projection, turned(view, turned(model, scaled)));
  return [0.5 * (1 + x / w), 0.5 * (1 - y / w)];
}
