// The 3D view of an arm: the solids, the camera, and when to draw. Runs in a worker, so that drawing cannot delay the
// heartbeats of jogging; arm_view.js runs it in the page if the browser cannot draw in a worker.

import { Arm } from "./solids.js";

const DEGREE = Math.PI / 180;
const SMOOTH = 0.05; // s: time constant with which the drawing follows the joints
const TURN = 0.4; // s for which the camera moves to another place
const STEEPEST = 89.5 * DEGREE;
const SLOW = 50; // ms for a frame, above which the drawing becomes simple
const SLOW_FRAMES = 6;
const PAUSE = 2; // pause after a frame that needs the processor or is slow, in parts of the time that the frame has taken
const LONGEST_PAUSE = 1000; // ms
const STILL = 500; // ms without a change after which a simple drawing is drawn once in full
const LOST = 2000; // ms after which the end of a frame is not awaited any longer
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const COLOURS = {
  light: { body: 0xf4f6f8, joint: 0x33414f, accent: 0x0e9bb8, ground: 0xf5f7f9, grid: 0xc9d2da, major: 0x9fb0bd,
    sky: 0xffffff, earth: 0xb9c4cd, trail: 0x0e7490, plate: 0x8b98a5 },
  dark: { body: 0xd7dee5, joint: 0x3a4856, accent: 0x22b8d6, ground: 0x0f151c, grid: 0x22303c, major: 0x35475a,
    sky: 0xdfeaf5, earth: 0x1a232d, trail: 0x38bdd8, plate: 0x55626f },
};

let THREE;

/**
 * Draws an arm on a canvas.
 *
 * A frame is begun only if something has changed and the previous frame is complete, so that no call waits for the
 * graphics processor. If frames take long, for example without a graphics processor, the drawing is simple while
 * something moves: without shadows, and with fewer pixels. Without a graphics processor, drawing takes at most a third
 * of the time, because the page itself, other pages and other programs need the processor, too.
 */
export class Drawing {
  constructor(three, canvas, dark, report) {
    THREE = three;
    this.canvas = canvas;
    this.report = report;
    this.colours = dark ? COLOURS.dark : COLOURS.light;
    this.software = isSoftware();
    this.simple = this.software;
    this.slow = 0;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.software });
    this.renderer.setClearColor(this.colours.ground);
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.gl = this.renderer.getContext();
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.02, 60);
    this.camera.up.set(0, 0, 1);
    this.eye = { target: new THREE.Vector3(), distance: 3, azimuth: 0, elevation: 0 };
    this.turning = null;
    this.width = this.height = 1;
    this.ratio = 1;
    this.arm = null;
    this.changed = false; // the next frame differs from the last one
    this.rough = false; // the last frame was drawn without shadows and with fewer pixels
    this.fence = null;
    this.resume = this.touched = this.began = 0;
    this.scheduled = false;
    canvas.addEventListener("webglcontextrestored", () => this.touch());
    this.light();
    report({ simple: this.simple });
  }

  // --- calls of the page

  size(width, height, ratio) {
    Object.assign(this, { width: Math.max(1, width), height: Math.max(1, height), ratio: Math.min(2, ratio || 1) });
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    this.touch();
  }

  build(model, place) {
    this.arm?.remove();
    this.goal = null;
    this.arm = new Arm(THREE, this.scene, this.colours, model.origins.map((row) => row.map((value) => value / 1000)), model.kind);
    this.shown = model.joints.slice();
    this.joints(this.shown);
    this.look(place, 0);
    this.report({ ready: true });
  }

  // The trail consists of the positions that the controller has reported, even if few frames are drawn.
  joints(values) {
    if (!this.arm || values.every((value, index) => value === this.goal?.[index])) return;
    this.goal = values;
    this.arm.place(values);
    this.arm.trace();
    this.arm.place(this.shown);
    this.touch();
  }

  look(name, seconds = TURN) {
    const r = this.arm?.reach ?? 1, middle = Math.max((this.arm?.shoulder ?? 0) * 0.95, r * 0.42), far = r * 2.15;
    const places = {
      iso: [far * 0.72, -far * 0.78, middle + far * 0.36],
      front: [far * 1.08, 0, middle],
      side: [0, -far * 1.08, middle],
      top: [0.001, -0.02, middle + far * 1.1],
    };
    const target = new THREE.Vector3(r * 0.16, 0, middle * 0.92);
    const away = new THREE.Vector3(...(places[name] || places.iso)).sub(target), distance = away.length();
    const goal = { target, distance, azimuth: Math.atan2(away.y, away.x), elevation: Math.asin(away.z / distance) };
    const half = Math.PI * 2;
    goal.azimuth += Math.round((this.eye.azimuth - goal.azimuth) / half) * half; // the shorter way
    this.turning = { from: { ...this.eye, target: this.eye.target.clone() }, goal, start: this.now(), seconds };
    this.touch();
  }

  orbit(x, y) {
    this.turning = null;
    this.eye.azimuth -= x * 2 * Math.PI;
    this.eye.elevation += y * 2 * Math.PI;
    this.touch();
  }

  pan(x, y) {
    this.turning = null;
    const size = 2 * this.eye.distance * Math.tan((this.camera.fov / 2) * DEGREE);
    const side = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0);
    const up = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 1);
    this.eye.target.addScaledVector(side, -x * size).addScaledVector(up, y * size);
    this.touch();
  }

  zoom(factor) {
    this.turning = null;
    this.eye.distance = Math.min(20, Math.max(0.1, this.eye.distance * factor));
    this.touch();
  }

  clear() {
    this.arm?.clear();
    this.touch();
  }

  simplify(simple) {
    Object.assign(this, { simple, decided: true });
    this.report({ simple });
    this.touch();
  }

  close() {
    this.closed = true;
    this.renderer.dispose();
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  // --- frames

  now() {
    return performance.now();
  }

  touch() {
    this.changed = true;
    this.touched = this.now();
    this.schedule();
  }

  schedule() {
    if (this.scheduled || this.closed) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.frame();
    });
  }

  frame() {
    const now = this.now();
    this.animate(now);
    if (!this.complete(now)) return this.schedule();
    const still = now - this.touched > STILL;
    if (this.changed || (this.rough && still)) {
      if (now < this.resume) return this.schedule();
      this.draw(this.simple && !still);
    }
    if (this.changed || this.rough || this.fence || this.turning || this.moving) this.schedule();
  }

  // Return true if the last frame is complete. How long it took determines the pause, and whether the drawing is simple.
  complete(now) {
    if (!this.fence) return true;
    const done = this.gl.getSyncParameter(this.fence, this.gl.SYNC_STATUS) === this.gl.SIGNALED;
    if (!done && now - this.began < LOST) return false;
    this.gl.deleteSync(this.fence);
    this.fence = null;
    const taken = now - this.began;
    if (this.software || taken > SLOW) this.resume = now + Math.min(PAUSE * taken, LONGEST_PAUSE);
    if (this.simple || this.decided || this.first) return true; // the first frame compiles the shaders
    this.slow = taken > SLOW ? this.slow + 1 : 0;
    if (this.slow === SLOW_FRAMES) {
      this.simple = true;
      this.report({ simple: true });
    }
    return true;
  }

  draw(rough) {
    const ratio = rough ? Math.min(1, this.ratio) : this.software ? 2 : this.ratio;
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    if (this.wide !== this.width || this.high !== this.height) {
      Object.assign(this, { wide: this.width, high: this.height });
      this.renderer.setSize(this.width, this.height, false);
    }
    this.sun.castShadow = !rough;
    this.aim();
    this.changed = false;
    this.rough = rough;
    this.first = !this.began;
    this.began = this.now();
    this.renderer.render(this.scene, this.camera);
    this.fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
  }

  aim() {
    const { target, distance, azimuth } = this.eye;
    const elevation = (this.eye.elevation = Math.min(STEEPEST, Math.max(-STEEPEST, this.eye.elevation)));
    this.camera.position.set(Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation));
    this.camera.position.multiplyScalar(distance).add(target);
    this.camera.lookAt(target);
    this.camera.updateMatrixWorld();
  }

  animate(now) {
    const past = (now - (this.last ?? now)) / 1000;
    this.last = now;
    if (this.turning) this.turn(now);
    if (!this.arm) return;
    const far = Math.max(...this.goal.map((goal, index) => Math.abs(goal - this.shown[index])));
    this.moving = far !== 0;
    if (!this.moving) return;
    const part = 1 - Math.exp(-past / SMOOTH);
    this.shown = this.goal.map((goal, index) => (far < 0.01 ? goal : this.shown[index] + (goal - this.shown[index]) * part));
    this.arm.place(this.shown);
    this.changed = true;
    this.touched = now;
  }

  turn(now) {
    const { from, goal, start, seconds } = this.turning;
    const x = seconds ? Math.min(1, (now - start) / 1000 / seconds) : 1, part = x * x * (3 - 2 * x);
    for (const name of ["distance", "azimuth", "elevation"]) this.eye[name] = from[name] + (goal[name] - from[name]) * part;
    this.eye.target.lerpVectors(from.target, goal.target, part);
    if (x === 1) this.turning = null;
    this.changed = true;
    this.touched = now;
  }

  // --- the scene

  light() {
    const { scene, colours } = this;
    scene.add(new THREE.HemisphereLight(colours.sky, colours.earth, 1.9));
    const sun = (this.sun = new THREE.DirectionalLight(0xffffff, 2.1));
    sun.position.set(1.6, -2.2, 3.2);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    Object.assign(sun.shadow.camera, { left: -1.3, right: 1.3, top: 1.3, bottom: -1.3, near: 0.5, far: 8 });
    sun.shadow.bias = -0.0008;
    sun.shadow.normalBias = 0.004;
    scene.add(sun);
    const rim = new THREE.DirectionalLight(0xd9ecf7, 0.6);
    rim.position.set(-2, 2, 1.2);
    scene.add(rim);
  }
}

function isSoftware() {
  try {
    const canvas = typeof OffscreenCanvas === "undefined" ? document.createElement("canvas") : new OffscreenCanvas(1, 1);
    const gl = canvas.getContext("webgl2"), info = gl.getExtension("WEBGL_debug_renderer_info");
    const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : gl.getParameter(gl.RENDERER);
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return SOFTWARE.test(name);
  } catch {
    return true;
  }
}

// --- in a worker: the first message contains the canvas, the further ones are calls

if (typeof document === "undefined") {
  let drawing = null, waiting = [];
  const call = ([name, ...values]) => drawing[name](...values);
  self.onmessage = async ({ data }) => {
    if (Array.isArray(data)) {
      if (drawing) call(data);
      else waiting.push(data);
      return;
    }
    try {
      const { THREE: three } = await import(data.three);
      drawing = new Drawing(three, data.canvas, data.dark, (state) => self.postMessage(state));
      waiting.forEach(call);
      waiting = [];
    } catch (error) {
      self.postMessage({ failed: `${error}` });
    }
  };
}
