// Air speeds in a load case by the jet model of verify/air/jets.py, in metres and m/s: surfaces and slices.

const GRID = 60000; // points at most among which a surface of equal speed is drawn
const ACROSS = 80; // cells of a slice along its longer side
const BANDS = ["#fcfdbf", "#fe9f6d", "#de4968", "#8c2981", "#3b0f70", "#000004"]; // below 0.5 m/s, each to twice as much
const SLOWEST = -2; // log2 of the speed where the first band begins

function clip(t) {
  return Math.max(0, Math.min(1, t));
}

class Air {
  constructor({ R, p, throttle, air }, number) {
    Object.assign(this, air);
    this.modules = R.map((turn, i) => {
      const v = throttle[number][i].map((share) => air.full * Math.sqrt(Math.max(0, share)));
      return { R: turn, p: p[i], v, U_H: Math.sqrt(v.reduce((sum, each) => sum + each * each, 0) / v.length) };
    });
  }

  // The sum of all modules' speeds at a point.
  at(point) {
    let sum = 0;
    for (const { R, p, v, U_H } of this.modules) {
      const away = point.map((x, axis) => x - p[axis]);
      const [a, b, up] = [0, 1, 2].map((k) => R[0][k] * away[0] + R[1][k] * away[1] + R[2][k] * away[2]);
      sum += this.fromModule(a, b, -up, v, U_H);
    }
    return sum;
  }

  fromModule(a, b, z, v, U_H) {
    const { rotors, radius, diameter, merged, fades, shear, jet } = this;
    const s = z / diameter;
    const from = Math.max(s, merged) + jet.origin;
    const beside = Math.hypot(a, b) / (diameter * jet.half_width * from);
    let most = (clip(s / merged) * jet.decay * U_H) / from / (1 + (Math.SQRT2 - 1) * beside * beside) ** 2;
    const g = 1 + z / Math.hypot(radius, z);
    const fade = s < 0 ? 0 : clip((merged - s) / fades);
    let inflow = 0;
    for (const [q, [x, y]] of rotors.entries()) {
      const aside = Math.hypot(a - x, b - y);
      if (fade) most = Math.max(most, v[q] * g * fade * clip(0.5 + (radius / Math.sqrt(g) - aside) / (2 * shear * (z + radius))));
      inflow += v[q] / (1 + (Math.SQRT2 * Math.hypot(Math.max(aside - radius, 0), z)) / radius) ** 2;
    }
    return Math.max(most, inflow);
  }

  // A trace of all points of a box with one speed.
  surface(speed, box) {
    const step = Math.cbrt(["x", "y", "z"].reduce((volume, axis) => volume * (box[axis][1] - box[axis][0]), 1 / GRID));
    const [x, y, z, value] = [[], [], [], []];
    for (const px of ticks(box.x, step)) {
      for (const py of ticks(box.y, step)) {
        for (const pz of ticks(box.z, step)) {
          x.push(px);
          y.push(py);
          z.push(pz);
          value.push(this.at([px, py, pz]));
        }
      }
    }
    const none = { show: false };
    return {
      type: "isosurface", uid: "air", meta: { part: "air" }, hoverinfo: "skip",
      x, y, z, value, isomin: speed, isomax: speed, surface: { count: 1 }, caps: { x: none, y: none, z: none },
      opacity: 0.35, colorscale: [[0, "#56b4e9"], [1, "#56b4e9"]], showscale: false,
    };
  }

  // A trace of the speeds in a plane across an axis.
  slice(across, at, box) {
    const [first, second] = ["x", "y", "z"].filter((axis) => axis !== across);
    const step = Math.max(...[first, second].map((axis) => box[axis][1] - box[axis][0])) / ACROSS;
    const points = ticks(box[first], step).map((u) => ticks(box[second], step).map((w) => ({ [across]: at, [first]: u, [second]: w })));
    const speeds = points.map((row) => row.map(({ x, y, z }) => this.at([x, y, z])));
    const bands = BANDS.flatMap((colour, k) => [[k / BANDS.length, colour], [(k + 1) / BANDS.length, colour]]);
    const ticked = BANDS.slice(1).map((_, k) => SLOWEST + 1 + k);
    const bar = { title: { text: "air [m/s]" }, len: 0.6, y: 0.45, x: 0, xanchor: "left", thickness: 12, outlinewidth: 0 };
    return {
      type: "surface", uid: "slice", meta: { part: "slice" },
      ...Object.fromEntries(["x", "y", "z"].map((axis) => [axis, points.map((row) => row.map((point) => point[axis]))])),
      surfacecolor: speeds.map((row) => row.map((speed) => Math.log2(speed))), cmin: SLOWEST, cmax: SLOWEST + BANDS.length,
      text: speeds.map((row) => row.map((speed) => `${speed.toPrecision(2)} m/s`)), hoverinfo: "text",
      showlegend: false, colorscale: bands, opacityscale: [[0, 0.25], [1 / BANDS.length, 0.25], [1 / BANDS.length, 0.85], [1, 0.85]], lighting: { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 },
      colorbar: { ...bar, tickvals: ticked, ticktext: ticked.map((power) => String(2 ** power)) },
    };
  }
}

// Numbers from one end of an interval to the other, as evenly as steps of about a size allow.
function ticks([low, high], step) {
  const count = Math.max(1, Math.round((high - low) / step));
  return Array.from({ length: count + 1 }, (_, k) => low + ((high - low) * k) / count);
}
