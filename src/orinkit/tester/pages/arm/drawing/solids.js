// The solids of an arm, drawn from its model, the ground below it, and the trail of its tool.

const DEGREE = Math.PI / 180;
const AXES = { "six-axis": ["z", "y", "y", "z", "y", "z"], scara: ["z", "z", "linear", "z"] };
const TRAIL = 600; // points
const TRAIL_STEP = 0.002; // m between two points of the trail

let THREE;

/** An arm in a scene. Lengths are in m, joints in deg, or mm if they are linear. */
export class Arm {
  constructor(three, scene, colours, origins, kind = "six-axis") {
    THREE = three;
    Object.assign(this, { scene, colours, turns: [], points: [], things: [], kinds: AXES[kind] });
    if (kind === "scara") this.buildScara(origins);
    else this.build(origins);
  }

  remove() {
    for (const each of this.things) this.scene.remove(each);
  }

  show(thing) {
    this.things.push(thing);
    this.scene.add(thing);
  }

  place(joints) {
    this.turns.forEach((group, index) => {
      const kind = this.kinds[index];
      if (kind === "linear") group.position.z = joints[index] / 1000;
      else group.rotation[kind] = joints[index] * DEGREE;
    });
  }

  clear() {
    this.points.length = 0;
    this.line.geometry.setDrawRange(0, 0);
  }

  material(colour, rough = 0.42, metal = 0.05) {
    return new THREE.MeshStandardMaterial({ color: colour, roughness: rough, metalness: metal });
  }

  add(parent, geometry, material, place = (mesh) => mesh) {
    const mesh = new THREE.Mesh(geometry, material);
    mesh.castShadow = mesh.receiveShadow = true;
    place(mesh);
    parent.add(mesh);
    return mesh;
  }

  // A cylinder with rounded edges along the y axis.
  drum(radius, length, round = 0.2) {
    const half = length / 2, edge = Math.min(radius, half) * round, points = [new THREE.Vector2(0, -half)];
    for (let step = 0; step <= 6; step++) {
      const angle = (step / 6) * Math.PI / 2;
      points.push(new THREE.Vector2(radius - edge + edge * Math.sin(angle), -half + edge - edge * Math.cos(angle)));
    }
    for (let step = 0; step <= 6; step++) {
      const angle = (step / 6) * Math.PI / 2;
      points.push(new THREE.Vector2(radius - edge + edge * Math.cos(angle), half - edge + edge * Math.sin(angle)));
    }
    points.push(new THREE.Vector2(0, half));
    return new THREE.LatheGeometry(points, 48);
  }

  // A tapered link in the x-z plane from the origin to (x, z), with round ends and a thickness along y.
  link(x, z, first, second, thick) {
    const length = Math.hypot(x, z);
    const lean = Math.asin(Math.max(-0.9, Math.min(0.9, (first - second) / Math.max(length, 1e-6))));
    const outline = [];
    for (let step = 0; step <= 24; step++) {
      const angle = Math.PI / 2 - lean + (step / 24) * (Math.PI + 2 * lean);
      outline.push(new THREE.Vector2(first * Math.cos(angle), first * Math.sin(angle)));
    }
    for (let step = 0; step <= 24; step++) {
      const angle = -Math.PI / 2 + lean + (step / 24) * (Math.PI - 2 * lean);
      outline.push(new THREE.Vector2(length + second * Math.cos(angle), second * Math.sin(angle)));
    }
    const bevel = Math.min(thick * 0.22, second * 0.45);
    const geometry = new THREE.ExtrudeGeometry(new THREE.Shape(outline), {
      depth: thick - 2 * bevel, bevelEnabled: true, bevelThickness: bevel, bevelSize: bevel, bevelOffset: -bevel,
      bevelSegments: 5, curveSegments: 24,
    });
    geometry.translate(0, 0, -(thick - 2 * bevel) / 2);
    geometry.rotateX(Math.PI / 2); // outline in x-z, thickness along y
    geometry.rotateY(-Math.atan2(z, x));
    return geometry;
  }

  // The frames of the joints, each inside the previous one.
  chain(root, origins) {
    let parent = root;
    return origins.map((origin) => {
      const place = new THREE.Group(), turn = new THREE.Group();
      place.position.set(...origin);
      place.add(turn);
      parent.add(place);
      parent = turn;
      this.turns.push(turn);
      return turn;
    });
  }

  // A SCARA: a column, two horizontal arms above the stroke of the shaft, and the shaft, which carries the flange.
  buildScara(origins) {
    const { colours } = this;
    const body = this.material(colours.body), joint = this.material(colours.joint, 0.5, 0.25);
    const accent = this.material(colours.accent, 0.35, 0.1), plate = this.material(colours.plate, 0.5, 0.1);
    const [, o2, o3, o4] = origins, second = [o3[0] + o4[0], o3[1] + o4[1]];
    const size = Math.hypot(o2[0], o2[1]) + Math.hypot(...second), thick = 0.12 * size;
    const zero = origins.reduce((sum, origin) => sum + origin[2], 0), level = Math.max(zero, 0) + 0.42 * size;
    this.reach = size;
    this.shoulder = level;
    this.ground(size);
    const upright = (mesh) => mesh.rotateX(Math.PI / 2);
    const root = new THREE.Group();
    this.show(root);
    this.root = root;
    const [g1, g2, , g4] = this.chain(root, origins);
    const radius = 0.11 * size, rod = 0.022 * size, top = level - origins[0][2];
    this.add(root, new THREE.BoxGeometry(0.4 * size, 0.4 * size, 0.022 * size), plate, (m) => m.position.set(0, 0, 0.011 * size));
    this.add(root, this.drum(radius, level - thick / 2, 0.1), body, (m) => upright(m).position.set(origins[0][0], origins[0][1], (level - thick / 2) / 2));
    // each arm is a link in the x-z plane, laid flat and turned to its direction
    const flat = (group, [x, y], from, to, height, colour) => this.add(group,
      this.link(Math.hypot(x, y), 0, from, to, thick).rotateX(-Math.PI / 2).rotateZ(Math.atan2(y, x)),
      colour, (m) => m.position.set(0, 0, height));
    flat(g1, o2, radius, radius * 0.85, top, body);
    this.add(g1, this.drum(radius * 0.6, thick * 1.1, 0.2), accent, (m) => upright(m).position.set(0, 0, top));
    const above = top - o2[2] + thick * 1.05;
    flat(g2, second, radius * 0.85, radius * 0.6, above, body);
    this.add(g2, this.drum(radius * 0.55, thick * 1.1, 0.2), accent, (m) => upright(m).position.set(0, 0, above));
    this.add(g2, this.drum(radius * 0.6, 0.3 * size, 0.2), body, (m) => upright(m).position.set(...second, above + 0.12 * size));
    const length = 0.85 * size;
    this.add(g4, this.drum(rod, length, 0.05), joint, (m) => upright(m).position.set(0, 0, length / 2));
    this.add(g4, this.drum(rod * 1.8, 0.014 * size, 0.3), plate, (m) => upright(m).position.set(0, 0, 0.007 * size));
    this.tip = g4;
    this.axes(g4, 0.19 * size);
    this.axes(root, 0.2 * size, 0.0009);
    this.trail();
  }

  build(origins) {
    const { colours } = this;
    const body = this.material(colours.body), joint = this.material(colours.joint, 0.5, 0.25);
    const accent = this.material(colours.accent, 0.35, 0.1), plate = this.material(colours.plate, 0.5, 0.1);
    const [o1, o2, o3, o4, o5, o6] = origins;
    const fore = [o4[0], 0, o4[2] + o5[2]];
    const upperLength = Math.hypot(o3[0], o3[2]), foreLength = Math.hypot(fore[0], fore[2]);
    const size = upperLength + foreLength, reach = size + Math.abs(o6[2]);
    this.reach = reach;
    this.shoulder = o1[2] + o2[2];
    this.ground(reach);
    const upright = (mesh) => mesh.rotateX(Math.PI / 2);
    const root = new THREE.Group();
    this.show(root);
    this.root = root;
    const [r1, r2, r3, r4, r5] = [0.135, 0.112, 0.094, 0.074, 0.066].map((part) => part * size);
    // base
    this.add(root, new THREE.BoxGeometry(0.44 * size, 0.44 * size, 0.022 * size), plate, (m) => m.position.set(0, 0, 0.011 * size));
    const top = Math.max(o1[2], 0.06 * size) * 0.9 + (o1[2] < 0.01 ? 0.02 * size : 0);
    this.add(root, this.drum(r1 * 1.12, top, 0.12), body, (m) => upright(m).position.set(0, 0, top / 2 + 0.02 * size));
    this.add(root, this.drum(r1 * 1.0, 0.02 * size, 0.3), accent, (m) => upright(m).position.set(0, 0, top + 0.026 * size));
    const [g1, g2, g3, g4, g5, g6] = this.chain(root, origins);
    // shoulder: a column from the base to joint 2
    const start = top + 0.034 * size - o1[2], column = Math.max(o2[2] - start, 0.02 * size);
    this.add(g1, this.drum(r1, column, 0.15), body, (m) => upright(m).position.set(0, 0, start + column / 2));
    this.add(g1, this.link(o2[0], o2[2] - start, r1 * 0.98, r2 * 1.0, 0.2 * size), body, (m) => m.position.set(0, o2[1], start));
    this.add(g1, this.drum(r2 * 1.02, 0.245 * size), joint, (m) => m.position.set(...o2));
    // upper arm
    this.add(g2, this.link(o3[0], o3[2], r2 * 0.98, r3 * 0.98, 0.15 * size), body);
    for (const side of [-1, 1]) {
      this.add(g2, this.drum(r2 * 0.62, 0.02 * size, 0.4), accent, (m) => m.position.set(0, side * 0.122 * size, 0));
      this.add(g2, this.drum(r3 * 0.6, 0.02 * size, 0.4), accent, (m) => m.position.set(o3[0], o3[1] + side * 0.104 * size, o3[2]));
    }
    this.add(g2, this.drum(r3, 0.205 * size), joint, (m) => m.position.set(...o3));
    // forearm: the first part turns with joint 3, the second with joint 4
    const split = 0.42 * fore[2];
    this.add(g3, this.link(fore[0] + 1e-6, split, r3 * 0.98, r4 * 1.02, 0.155 * size), body, (m) => m.position.set(0, o4[1] / 2, 0));
    this.add(g3, this.drum(r4 * 1.1, 0.03 * size, 0.3), joint, (m) => upright(m).position.set(fore[0], o4[1], split + 0.02 * size));
    const from = split + 0.035 * size - o4[2], rest = o5[2] - from;
    if (rest > 0.02 * size) {
      this.add(g4, this.drum(r4, rest, 0.1), body, (m) => upright(m).position.set(0, 0, from + rest / 2));
      this.add(g4, this.drum(r4 * 1.015, 0.014 * size, 0.3), accent, (m) => upright(m).position.set(0, 0, from + 0.03 * size));
    }
    this.add(g4, this.drum(r4 * 0.98, 0.15 * size), body, (m) => m.position.set(o5[0], 0, o5[2]));
    this.add(g4, this.drum(r5 * 0.72, 0.166 * size), joint, (m) => m.position.set(o5[0], 0, o5[2]));
    // wrist and flange
    const wrist = Math.max(o6[2], 0.05 * size);
    this.add(g5, this.drum(r5 * 0.86, wrist, 0.15), joint, (m) => upright(m).position.set(o6[0], o5[1] + o6[1], wrist / 2));
    this.add(g6, this.drum(r5 * 0.84, 0.018 * size, 0.3), plate, (m) => upright(m).position.set(0, 0, -0.004 * size));
    for (let hole = 0; hole < 4; hole++) {
      const angle = Math.PI / 4 + (hole * Math.PI) / 2;
      this.add(g6, this.drum(r5 * 0.09, 0.004 * size, 0.1), joint,
        (m) => upright(m).position.set(r5 * 0.55 * Math.cos(angle), r5 * 0.55 * Math.sin(angle), 0.0055 * size));
    }
    this.tip = g6;
    this.axes(g6, 0.19 * size);
    this.axes(root, 0.2 * size, 0.0009);
    this.trail();
  }

  axes(parent, length, lift = 0) {
    const colours = [0xe5484d, 0x30a46c, 0x3b82f6];
    colours.forEach((colour, axis) => {
      const material = new THREE.MeshBasicMaterial({ color: colour }), group = new THREE.Group();
      const shaft = new THREE.Mesh(new THREE.CylinderGeometry(length * 0.018, length * 0.018, length * 0.86, 12), material);
      shaft.position.y = length * 0.43;
      const head = new THREE.Mesh(new THREE.ConeGeometry(length * 0.05, length * 0.15, 20), material);
      head.position.y = length * 0.93;
      group.add(shaft, head);
      if (axis === 0) group.rotateZ(-Math.PI / 2);
      if (axis === 2) group.rotateX(Math.PI / 2);
      group.position.z = lift;
      parent.add(group);
    });
  }

  ground(reach) {
    const { colours } = this, span = Math.max(1.2, Math.ceil(reach * 2 * 5) / 5 + 0.8);
    const floor = new THREE.Mesh(new THREE.CircleGeometry(span * 3, 64),
      new THREE.MeshBasicMaterial({ color: colours.ground }));
    floor.position.z = -0.0025;
    this.show(floor);
    const shade = new THREE.Mesh(new THREE.PlaneGeometry(span * 2, span * 2), new THREE.ShadowMaterial({ opacity: 0.22 }));
    shade.receiveShadow = true;
    shade.position.z = -0.001;
    this.show(shade);
    for (const [step, colour, lift] of [[0.1, colours.grid, -0.002], [0.5, colours.major, -0.0015]]) {
      const count = Math.round((span * 2) / step), grid = new THREE.GridHelper(count * step, count, colour, colour);
      grid.rotateX(Math.PI / 2);
      grid.position.z = lift;
      grid.material.transparent = true;
      grid.material.opacity = 0.75;
      this.show(grid);
    }
    this.scene.fog = new THREE.Fog(colours.ground, reach * 3, reach * 7);
  }

  trail() {
    const geometry = new THREE.BufferGeometry();
    this.places = new THREE.BufferAttribute(new Float32Array(TRAIL * 3), 3);
    this.fades = new THREE.BufferAttribute(new Float32Array(TRAIL * 4), 4);
    geometry.setAttribute("position", this.places);
    geometry.setAttribute("color", this.fades);
    geometry.setDrawRange(0, 0);
    const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false, fog: false }));
    line.frustumCulled = false;
    this.show(line);
    this.line = line;
  }

  trace() {
    this.root.updateMatrixWorld(true);
    const tip = new THREE.Vector3().setFromMatrixPosition(this.tip.matrixWorld), points = this.points;
    if (points.length && tip.distanceTo(points[points.length - 1]) < TRAIL_STEP) return;
    points.push(tip);
    if (points.length > TRAIL) points.shift();
    const colour = new THREE.Color(this.colours.trail);
    points.forEach((point, index) => {
      this.places.setXYZ(index, point.x, point.y, point.z);
      this.fades.setXYZW(index, colour.r, colour.g, colour.b, ((index + 1) / points.length) ** 1.5);
    });
    this.places.needsUpdate = this.fades.needsUpdate = true;
    this.line.geometry.setDrawRange(0, points.length);
  }
}
