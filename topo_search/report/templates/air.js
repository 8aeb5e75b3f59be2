// Air speeds in a load case by the jet model of verify/air/jets.py, in m/s: surfaces and slices.

const GRID = 60000; // largest number of grid points for a surface of equal speed
const ACROSS = 120; // number of cells of a slice along its longer side
const COLOUR = "#56b4e9"; // of a surface
// The six tetrahedra of a cell around its diagonal, by corners numbered x + 2 y + 4 z.
const TETRAHEDRA = [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];
const BANDS = ["#fcfdbf", "#fe9f6d", "#de4968", "#8c2981", "#3b0f70", "#000004"]; // the first ends at 0.5 m/s, each next one at twice the speed
const SLOWEST = -2; // log2 of the nominal start of the first band

function clip(t) {
  return Math.max(0, Math.min(1, t));
}

// Returns the depth of a point below a start along an axis, and its distance from that axis.
function along(x, start, axis) {
  const away = x.map((part, k) => part - start[k]);
  const z = -away.reduce((sum, part, k) => sum + part * axis[k], 0);
  return [z, Math.hypot(...away.map((part, k) => part + z * axis[k]))];
}

class Air {
  constructor({ R, p, throttle, air }, number) {
    const { of, types, ...model } = air;
    Object.assign(this, model);
    this.modules = R.map((turn, i) => ({
      ...types[of[i]],
      R: turn,
      p: p[i],
      squares: throttle[number][i].map((share, q) => types[of[i]].rotors[q].full ** 2 * Math.max(0, share)), // of induced speeds
    }));
  }

  // Returns the sum of all modules' speeds at a point.
  at(point) {
    let sum = 0;
    for (const { R, p, ...air } of this.modules) {
      const away = point.map((x, axis) => x - p[axis]);
      sum += this.fromModule([0, 1, 2].map((k) => R[0][k] * away[0] + R[1][k] * away[1] + R[2][k] * away[2]), air);
    }
    return sum;
  }

  fromModule(x, { rotors, jet, squares }) {
    const { merged, merges, shear } = this;
    const places = rotors.map(({ at, axis }) => along(x, at, axis));
    const sinks = rotors.map(({ radius }, q) => {
      const [z, r] = places[q];
      return 1 / (1 + (Math.SQRT2 * Math.hypot(Math.max(r - radius, 0), z)) / radius) ** 2;
    });
    const sink = sinks.reduce((sum, each) => sum + each, 0);
    const square = rotors.reduce((sum, rotor, q) => {
      const { radius } = rotor;
      const [z, r] = places[q];
      const [depth, aside] = along(x, rotor.start, rotor.against);
      const s = depth / rotor.diameter;
      const from = Math.max(s, merged) + jet.origin;
      const across = aside / (rotor.diameter * jet.half_width * from);
      const share = clip((s - merged) / merges + 1);
      const far = share * rotor.share * (jet.decay / from / (1 + (Math.SQRT2 - 1) * across * across) ** 2) ** 2;
      const g = 1 + z / Math.hypot(radius, z);
      const [delta, area] = [shear * (z + radius), (radius * radius) / g];
      const core = area - (2 / 9) * delta * delta;
      const outer = area >= (2 / 3) * delta * delta ? (4 / 3) * delta + Math.sqrt(core) : (24 * delta * delta * area) ** 0.25;
      const slipstream = z < 0 ? 0 : (1 - share) * (g * clip((outer - r) / (2 * delta))) ** 2;
      return sum + squares[q] * Math.max(slipstream + far, sinks[q] * sink);
    }, 0);
    return Math.sqrt(square);
  }

  // Returns the surface of equal speed in a box, by marching tetrahedra.
  surface(speed, box) {
    const step = Math.cbrt(box.reduce((volume, [low, high]) => volume * (high - low), 1 / GRID));
    const axes = box.map((side) => ticks(side, step));
    const [nx, ny, nz] = axes.map((axis) => axis.length);
    const point = (i) => [axes[0][i % nx], axes[1][Math.floor(i / nx) % ny], axes[2][Math.floor(i / nx / ny)]];
    const beyond = Float32Array.from({ length: nx * ny * nz }, (_, i) => this.at(point(i)) - speed);
    const [corners, faces, known] = [[], [], new Map()];
    const crossing = (inside, outside) => {
      const edge = Math.min(inside, outside) * beyond.length + Math.max(inside, outside);
      if (!known.has(edge)) {
        known.set(edge, corners.length / 3);
        const share = beyond[inside] / (beyond[inside] - beyond[outside]);
        const to = point(outside);
        corners.push(...point(inside).map((x, axis) => x + share * (to[axis] - x)));
      }
      return known.get(edge);
    };
    for (let k = 0; k < nz - 1; k++) for (let j = 0; j < ny - 1; j++) for (let i = 0; i < nx - 1; i++) {
      const cell = [0, 1, 2, 3, 4, 5, 6, 7].map((c) => i + (c & 1) + nx * (j + ((c >> 1) & 1) + ny * (k + (c >> 2))));
      for (const tetrahedron of TETRAHEDRA) {
        const all = tetrahedron.map((c) => cell[c]);
        const [inside, outside] = [all.filter((c) => beyond[c] > 0), all.filter((c) => beyond[c] <= 0)];
        if (!inside.length || !outside.length) continue;
        const ends = inside.flatMap((a) => outside.map((b) => crossing(a, b)));
        const triangles = ends.length === 3 ? [ends] : [[ends[0], ends[1], ends[2]], [ends[1], ends[3], ends[2]]];
        for (const face of triangles) faces.push(...outwards(face, corners, point(inside[0])));
      }
    }
    return Object.assign(new THREE.Mesh(surface({ corners, faces }), paint(COLOUR, 0.35)), { name: "air" });
  }

  // Returns the speeds in a plane normal to an axis (0, 1 or 2); its tooltip is the speed at the pointer.
  slice(across, at, box) {
    const [first, second] = [0, 1, 2].filter((axis) => axis !== across);
    const step = Math.max(...[first, second].map((axis) => box[axis][1] - box[axis][0])) / ACROSS;
    const [columns, rows] = [first, second].map((axis) => ticks(box[axis], step));
    const place = (u, w) => Object.values({ [across]: at, [first]: u, [second]: w });
    const colours = BANDS.map((colour, band) => [...bytes(colour), band ? 160 : 40]);
    const pixels = rows.flatMap((w) => columns.flatMap((u) => {
      const band = Math.floor(Math.log2(this.at(place(u, w))) - SLOWEST);
      return colours[Math.max(0, Math.min(BANDS.length - 1, band))];
    }));
    const map = new THREE.DataTexture(Uint8Array.from(pixels), columns.length, rows.length);
    Object.assign(map, { encoding: THREE.sRGBEncoding, magFilter: THREE.LinearFilter, needsUpdate: true });
    const corners = [0, 1].flatMap((w) => [0, 1].flatMap((u) => place(box[first][u], box[second][w])));
    const geometry = surface({ corners, faces: [0, 1, 3, 0, 3, 2] });
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute([0, 0, 1, 0, 0, 1, 1, 1], 2));
    const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ map, transparent: true, depthWrite: false, side: THREE.DoubleSide }));
    mesh.name = "slice";
    mesh.userData.tooltip = ({ point }) => `${this.at(point.toArray()).toPrecision(2)} m/s`;
    return mesh;
  }
}

// Returns red, green and blue of a colour.
function bytes(colour) {
  return [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
}

// Orients a triangle so that a point lies behind it.
function outwards([a, b, c], corners, behind) {
  const at = (i) => new THREE.Vector3(corners[3 * i], corners[3 * i + 1], corners[3 * i + 2]);
  const [A, B, C] = [a, b, c].map(at);
  const away = A.clone().sub(new THREE.Vector3(...behind));
  return B.sub(A).cross(C.sub(A)).dot(away) > 0 ? [a, b, c] : [a, c, b];
}

// Divides an interval evenly into steps of about the given size.
function ticks([low, high], step) {
  const count = Math.max(1, Math.round((high - low) / step));
  return Array.from({ length: count + 1 }, (_, k) => low + ((high - low) * k) / count);
}
