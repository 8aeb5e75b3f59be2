// The three.js scene of a view: a canvas with lights, a floor grid for scale, and an orbiting camera.

THREE.ColorManagement.legacyMode = false; // use the colours of the page unchanged

const FIELD = 28; // vertical field of view [degrees]
const AROUND = 1.1; // margin around the framed points
const TURNS = { ArrowLeft: [-1, 0, 1], ArrowRight: [1, 0, 1], ArrowUp: [0, 1, 1], ArrowDown: [0, -1, 1], "+": [0, 0, 0.9], "-": [0, 0, 1 / 0.9] };

class Stage {
  constructor(element, towards, turned) {
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.canvas = this.renderer.domElement;
    this.element = element;
    element.replaceChildren(this.canvas);
    this.camera = new THREE.PerspectiveCamera(FIELD);
    this.camera.up.set(0, 0, 1);
    this.towards = towards;
    this.turned = turned; // called when the user turns the view
    this.drawn = () => {}; // called after each frame
    this.first = { across: Math.atan2(towards[1], towards[0]), up: Math.asin(towards[2]), far: 1, aside: [0, 0] };
    this.orbit = this.first;
    this.sun = new THREE.DirectionalLight(0xffffff, 0.75);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.normalBias = 0.002;
    this.lamp = new THREE.DirectionalLight(0xffffff, 0.2); // from the viewer, so that no side is dark
    this.floor = new THREE.Group();
    this.content = new THREE.Group();
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x9098a8, 0.6), this.sun, this.sun.target, this.lamp, this.floor, this.content);
    this.middle = new THREE.Vector3();
    this.framed = [this.middle];
    this.follow();
    this.watch = new ResizeObserver(() => this.render());
    this.watch.observe(element);
  }

  remove() {
    this.watch.disconnect();
    this.clear(this.content);
    this.clear(this.floor);
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  clear(group) {
    for (const object of [...group.children]) {
      object.geometry.dispose();
      object.material.map?.dispose();
      object.material.dispose();
      group.remove(object);
    }
  }

  // Fits the view to these points and puts the floor below them.
  frame(points) {
    const box = new THREE.Box3().setFromPoints(points);
    box.getCenter(this.middle);
    this.framed = points;
    const size = box.getSize(new THREE.Vector3()).length();
    const rough = size / 8;
    const ten = 10 ** Math.floor(Math.log10(rough));
    this.cell = ten * ([1, 2, 5].find((step) => step * ten >= rough) ?? 10);
    const half = 2 * Math.ceil((0.7 * size) / (2 * this.cell)) * this.cell;
    const level = box.min.z - 0.12 * size;
    const far = 3 * size;
    this.sun.position.copy(this.middle).add(new THREE.Vector3(-0.25, -0.35, 1).multiplyScalar(size));
    this.sun.target.position.copy(this.middle);
    Object.assign(this.sun.shadow.camera, { left: -size, right: size, top: size, bottom: -size, near: 0.01 * size, far });
    this.sun.shadow.camera.updateProjectionMatrix();
    this.clear(this.floor);
    const shade = new THREE.Mesh(new THREE.PlaneGeometry(2 * half, 2 * half), new THREE.ShadowMaterial({ opacity: 0.22 }));
    shade.receiveShadow = true;
    const line = dark() ? 0x3d424b : 0xd5d9de;
    const grid = new THREE.GridHelper(2 * half, Math.round((2 * half) / this.cell), line, line);
    grid.rotation.x = Math.PI / 2;
    for (const object of [shade, grid]) object.position.set(this.middle.x, this.middle.y, level);
    grid.position.z -= 1e-3 * size;
    this.floor.add(shade, grid);
    this.render();
  }

  // Turns, comes closer and moves aside; the angles in radians, the way aside in pictures.
  turn([across, up, closer], [right, above] = [0, 0]) {
    const { orbit } = this;
    this.orbit = {
      across: orbit.across + across,
      up: Math.max(-1.5, Math.min(1.5, orbit.up + up)),
      far: Math.max(0.1, Math.min(8, orbit.far * closer)),
      aside: [orbit.aside[0] + right, orbit.aside[1] + above],
    };
    this.moved();
  }

  moved() {
    this.render();
    this.turned(this.orbit);
  }

  // One pointer orbits, two fingers or the wheel zoom, the right button or shift pans.
  follow() {
    const { canvas } = this;
    const down = new Map();
    const spread = () => {
      const [one, two] = down.values();
      return Math.hypot(one.clientX - two.clientX, one.clientY - two.clientY);
    };
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => {
      down.set(event.pointerId, event);
      canvas.setPointerCapture(event.pointerId);
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => down.delete(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      const last = down.get(event.pointerId);
      if (!last) return;
      const before = down.size === 2 ? spread() : 1;
      down.set(event.pointerId, event);
      const [x, y] = [event.clientX - last.clientX, event.clientY - last.clientY].map((step) => step / canvas.clientHeight / down.size);
      if (event.buttons === 2 || event.shiftKey) this.turn([0, 0, 1], [-x, y]);
      else this.turn([-4 * x, 4 * y, down.size === 2 ? before / spread() : 1]);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.turn([0, 0, Math.exp(0.0012 * event.deltaY)]);
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.reset());
  }

  key(event) {
    const [across, up, closer] = TURNS[event.key] ?? [];
    if (closer === undefined && event.key !== "0") return;
    event.preventDefault();
    if (closer) this.turn([0.12 * across, 0.12 * up, closer]);
    else this.reset();
  }

  reset() {
    this.orbit = this.first;
    this.moved();
  }

  // Places the camera so that the framed points fill the picture as seen from the first viewpoint.
  aim(aspect) {
    const { camera } = this;
    const tall = Math.tan((FIELD / 2) * (Math.PI / 180));
    const [x, y, z] = this.towards;
    const flat = Math.hypot(x, y);
    const [right, above, towards] = [[-y / flat, x / flat, 0], [(-x * z) / flat, (-y * z) / flat, flat], [x, y, z]].map((axis) => new THREE.Vector3(...axis));
    const away = this.framed.map((point) => {
      const at = point.clone().sub(this.middle);
      return at.dot(towards) + Math.max(Math.abs(at.dot(above)) / tall, Math.abs(at.dot(right)) / tall / aspect);
    });
    const { across, up, far, aside } = this.orbit;
    const distance = AROUND * far * Math.max(...away, 1e-3);
    const direction = new THREE.Vector3(Math.cos(up) * Math.cos(across), Math.cos(up) * Math.sin(across), Math.sin(up));
    camera.position.copy(direction).multiplyScalar(distance);
    camera.lookAt(0, 0, 0);
    const move = new THREE.Vector3(aside[0], aside[1], 0).multiplyScalar(2 * tall * distance).applyQuaternion(camera.quaternion);
    camera.position.add(this.middle).add(move);
    Object.assign(camera, { aspect, near: distance / 100, far: 100 * distance });
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    this.lamp.position.copy(camera.position);
    this.lamp.target.position.copy(this.middle);
  }

  // Draws in the browser's next frame.
  render() {
    this.waiting ??= requestAnimationFrame(() => this.picture());
  }

  picture(width = this.element.clientWidth, height = this.element.clientHeight) {
    cancelAnimationFrame(this.waiting);
    this.waiting = undefined;
    if (!width || !height) return;
    if (this.size !== `${width} ${height}`) {
      this.size = `${width} ${height}`;
      this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
      this.renderer.setSize(width, height);
    }
    this.aim(width / height);
    this.renderer.render(this.scene, this.camera);
    this.drawn();
  }

  // Returns the position of a point in the picture [px].
  onScreen(at) {
    const { x, y } = new THREE.Vector3(...at).project(this.camera);
    return [((1 + x) / 2) * this.canvas.clientWidth, ((1 - y) / 2) * this.canvas.clientHeight];
  }

  // Returns the projections of the task's unit axes.
  axes() {
    return [0, 1, 2].map((axis) => {
      const { x, y } = new THREE.Vector3().setComponent(axis, 1).applyQuaternion(this.camera.quaternion.clone().invert());
      return [x, -y];
    });
  }

  // Returns the first object under the pointer that has a tooltip.
  under({ offsetX, offsetY }) {
    const ray = new THREE.Raycaster();
    const at = new THREE.Vector2((2 * offsetX) / this.canvas.clientWidth - 1, 1 - (2 * offsetY) / this.canvas.clientHeight);
    ray.setFromCamera(at, this.camera);
    return ray.intersectObjects(this.content.children.filter((object) => object.userData.tooltip))[0];
  }
}

// Returns a geometry from vertices and triangles, three numbers each.
function surface({ corners, faces }) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners, 3));
  geometry.setIndex(faces);
  geometry.computeVertexNormals();
  return geometry;
}

function paint(colour, opacity = 1) {
  const faint = opacity < 1;
  return new THREE.MeshStandardMaterial({ color: colour, opacity, transparent: faint, depthWrite: !faint, roughness: 0.65, metalness: 0.05, side: THREE.DoubleSide, polygonOffset: faint, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
}
