// The robot in 3D: one object per arm, moved by one message a tick with the frames of all links (scene_source.py).
import { data, denied, hasControl, isPast, onTick, say } from "./live.js";
import { OrbitControls } from "./three/OrbitControls.js";
import * as THREE from "./three/three.module.min.js";
import { WallModels } from "./walls.js";

const COLOURS = { PSM: ["#4f9cf0", "#3fbf8f", "#b98cf0", "#5cc6d0"], MTM: ["#e8a33d", "#d9793f"], ECM: ["#e36a8d"] };
const GREY = "#8a939c";
const FAULT = "#e5484d";
const NEAR = "#ff9f1c";
const GHOST = "#2dd4bf";
const FAINT = { transparent: true, opacity: 0.35, depthWrite: false };
const TRAIL = 200;
const UP = new THREE.Vector3(0, 1, 0);
const MARGIN = 1.12; // around the camera's objects
const NEAREST = 0.5; // m

const pose = (frames, i, position, turn) => {
  position.set(frames[7 * i], frames[7 * i + 1], frames[7 * i + 2]);
  turn.set(frames[7 * i + 3], frames[7 * i + 4], frames[7 * i + 5], frames[7 * i + 6]);
};

class ArmModel {
  constructor(name, drawn, colour, ghost) {
    this.name = name;
    this.isRemote = drawn.type !== "MTM"; // turns about a point in the patient's wall
    this.colour = new THREE.Color(colour);
    this.group = new THREE.Group();
    const look = ghost ? FAINT : {};
    this.body = new THREE.MeshStandardMaterial({ color: colour, roughness: 0.55, metalness: 0.1, ...look });
    this.steel = new THREE.MeshStandardMaterial({ color: ghost ? colour : "#b9c2cb", roughness: 0.35, metalness: 0.4, ...look });
    this.warn = new THREE.MeshStandardMaterial({ color: NEAR, roughness: 0.5, ...look });
    this.links = [];
    this.joints = [];
    this.at = [];
    this.turn = new THREE.Quaternion();
    this.base = new THREE.Quaternion();
    this.size = 0;
    this.tip = new THREE.Group();
    if (!ghost) this.tip.add(new THREE.AxesHelper(0.03));
    this.fingers = [-1, 1].map((side) => {
      const finger = new THREE.Mesh(new THREE.ConeGeometry(0.0028, 0.017, 8).rotateX(Math.PI / 2).translate(0, 0, 0.0085), this.steel);
      finger.userData.side = side;
      return finger;
    });
    this.jaw = new THREE.Group();
    this.jaw.add(...this.fingers);
    this.rail = new THREE.Group();
    this.carriage = new THREE.Group();
    if (this.isRemote) {
      this.rail.add(this.box(0.035, 0.03, 0.4, 0, 0.065, -0.28), this.box(0.03, 0.065, 0.03, 0, 0.032, -0.09));
      this.rail.add(new THREE.Mesh(new THREE.CylinderGeometry(0.0065, 0.0065, 0.08, 20, 1, true).rotateX(Math.PI / 2).translate(0, 0, -0.03), this.steel));
      this.rail.add(new THREE.Mesh(new THREE.TorusGeometry(0.012, 0.0022, 8, 28), this.steel));
      this.carriage.add(this.box(0.055, 0.085, 0.07, 0, 0.025, -0.02));
    } else this.carriage.add(this.box(0.09, 0.09, 0.03, 0, 0, 0));
    this.group.add(this.tip, this.jaw, this.rail, this.carriage);
    if (!ghost) {
      this.trail = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: colour, transparent: true, opacity: 0.6 }));
      this.trail.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL), 3));
      this.trail.frustumCulled = false;
      this.count = 0;
      this.group.add(this.trail);
    }
  }

  box(x, y, z, atX, atY, atZ) {
    return new THREE.Mesh(new THREE.BoxGeometry(x, y, z).translate(atX, atY, atZ), this.body);
  }

  resize(size) {
    this.group.remove(...this.links, ...this.joints);
    this.size = size;
    this.at = Array.from({ length: size }, () => new THREE.Vector3());
    const radius = (i) => (this.isRemote ? (i <= 3 ? 0.0042 : 0.003) : 0.017 - 0.0012 * i);
    this.links = Array.from({ length: size - 1 }, (_, i) => new THREE.Mesh(new THREE.CylinderGeometry(radius(i), radius(i + 1), 1, 18), this.isRemote ? this.steel : this.body));
    this.joints = Array.from({ length: size - 2 }, (_, i) => new THREE.Mesh(new THREE.SphereGeometry(this.isRemote ? 0.0042 : 0.022 - 0.0014 * i, 18, 12), this.isRemote ? this.steel : this.body));
    this.group.add(...this.links, ...this.joints);
  }

  show(arm) {
    const { frames } = arm;
    const size = frames.length / 7;
    this.group.visible = size > 1 && !this.isHidden;
    if (size < 2) return;
    if (size !== this.size) this.resize(size);
    const along = new THREE.Vector3();
    for (let i = 0; i < size; i++) {
      pose(frames, i, this.at[i], this.turn);
      if (!i) this.base.copy(this.turn);
    }
    for (let i = 0; i + 1 < size; i++) {
      const link = this.links[i];
      along.subVectors(this.at[i + 1], this.at[i]);
      const length = along.length();
      link.visible = length > 0.001 && !(this.isRemote && i === 2); // from the centre to the carriage there is the shaft
      link.position.addVectors(this.at[i], this.at[i + 1]).multiplyScalar(0.5);
      link.scale.set(1, length, 1);
      if (length > 0.001) link.quaternion.setFromUnitVectors(UP, along.divideScalar(length));
    }
    this.joints.forEach((joint, i) => {
      joint.position.copy(this.at[i + 1]);
      joint.material = arm.near?.[i] ? this.warn : this.isRemote ? this.steel : this.body;
      joint.scale.setScalar(arm.near?.[i] ? 1.5 : 1);
      joint.visible = !this.isRemote || i > 2 || Boolean(arm.near?.[i]);
    });
    pose(frames, size - 1, this.tip.position, this.tip.quaternion);
    this.jaw.visible = arm.jaw !== null && arm.jaw !== undefined;
    if (this.jaw.visible) {
      this.jaw.position.copy(this.at[size - 2]);
      this.jaw.quaternion.copy(this.tip.quaternion);
      for (const finger of this.fingers) finger.rotation.x = (finger.userData.side * arm.jaw) / 2;
    }
    const carried = this.isRemote ? Math.min(3, size - 2) : 0;
    pose(frames, carried, this.carriage.position, this.carriage.quaternion);
    if (this.isRemote) {
      this.rail.quaternion.copy(this.carriage.quaternion);
      this.rail.position.copy(this.at[0]);
    }
    const isKnown = arm.valid !== false && arm.state !== "DISABLED"; // else its pose is unknown
    this.body.color.set(arm.late ? GREY : arm.state === "FAULT" ? FAULT : isKnown ? this.colour : GREY);
    if (this.trail) this.draw(this.tip.position);
    this.parts?.show(arm);
  }

  draw(tip) {
    const points = this.trail.geometry.attributes.position;
    const last = this.count && Math.hypot(points.array[3 * this.count - 3] - tip.x, points.array[3 * this.count - 2] - tip.y, points.array[3 * this.count - 1] - tip.z);
    if (this.count && last < 0.0005) return;
    if (this.count === TRAIL) points.array.copyWithin(0, 3);
    else this.count += 1;
    points.setXYZ(this.count - 1, tip.x, tip.y, tip.z);
    points.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, this.count);
  }
}

const STEEL = "#9fb0c0";

// A setup arm: from the column of its cart to the arm that it carries, in the frame of the cart.
class SetupModel {
  constructor(ghost) {
    this.group = new THREE.Group();
    this.at = [];
    this.isGhost = ghost;
    this.body = new THREE.MeshStandardMaterial({ color: ghost ? GHOST : STEEL, roughness: 0.6, metalness: 0.15, ...(ghost ? FAINT : {}) });
    this.links = [];
  }

  part(radius, end) {
    return new THREE.Mesh(new THREE.CylinderGeometry(radius, end, 1, 20), this.body);
  }

  show(arm) {
    const size = arm.frames.length / 7;
    if (size !== this.at.length) {
      this.group.remove(...this.links);
      this.at = Array.from({ length: size }, () => new THREE.Vector3());
      this.links = this.at.slice(1).map((_, i) => (i + 2 < size ? this.part(0.038 - 0.003 * i, 0.038 - 0.003 * i) : this.part(0.014, 0.008)));
      this.joints = this.at.slice(1, -1).map((_, i) => new THREE.Mesh(new THREE.SphereGeometry(0.045 - 0.003 * i, 20, 14), this.body));
      this.links.push(...this.joints);
      this.group.add(...this.links);
    }
    this.at.forEach((at, i) => at.set(...arm.frames.slice(7 * i, 7 * i + 3)));
    const along = new THREE.Vector3();
    for (let i = 0; i + 1 < size; i++) {
      along.subVectors(this.at[i + 1], this.at[i]);
      const length = along.length();
      this.links[i].visible = length > 0.001;
      this.links[i].position.addVectors(this.at[i], this.at[i + 1]).multiplyScalar(0.5);
      this.links[i].scale.set(1, length, 1);
      if (length > 0.001) this.links[i].quaternion.setFromUnitVectors(UP, along.divideScalar(length));
    }
    this.joints.forEach((joint, i) => joint.position.copy(this.at[i + 1]));
    if (this.isGhost) return;
    this.isGrey = arm.late || !arm.valid;
    this.body.color.set(this.isGrey ? GREY : STEEL);
    this.body.opacity = this.isGrey ? 0.45 : 1;
    this.body.transparent = this.isGrey;
  }
}

// The carrier of setup arms: a column with its foot, up to the base of the highest arm.
function column(setups) {
  const top = Math.max(...setups.flatMap((setup) => setup.at.slice(0, 3).map((at) => at.z)));
  const paint = new THREE.MeshStandardMaterial({ color: "#7c8a98", roughness: 0.7 });
  const made = new THREE.Group();
  made.add(new THREE.Mesh(new THREE.BoxGeometry(0.16, 0.16, top).translate(0, 0, top / 2), paint));
  made.add(new THREE.Mesh(new THREE.BoxGeometry(0.6, 0.75, 0.09).translate(0, 0.1, 0.045), paint));
  return made;
}

// Orientation of the poses' frame in the room, z up: an endoscope's frame looks down, the operator's ahead.
function rooted(frame) {
  const matrix = new THREE.Matrix4();
  if (frame === "HRSV") return matrix.makeRotationX(Math.PI / 2);
  if (frame === "ECM") return matrix.makeRotationX(Math.PI);
  return matrix;
}

// Corners of the box around a part, in the room.
function corners(part) {
  if (!part.children.length) return [];
  const { min, max } = new THREE.Box3().setFromObject(part);
  return [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new THREE.Vector3(x, y, z))));
}

const HANDLE = new THREE.SphereGeometry(0.018, 20, 14);

// A virtual hand: it pulls at the tip of an emulated robot, to where the pointer is, twenty times a second.
class Hand {
  constructor(stage) {
    this.stage = stage;
    this.ray = new THREE.Raycaster();
    this.plane = new THREE.Plane();
    this.goal = new THREE.Vector3();
  }

  aim(event) {
    const box = this.stage.renderer.domElement.getBoundingClientRect();
    this.ray.setFromCamera(new THREE.Vector2(((event.clientX - box.left) / box.width) * 2 - 1, 1 - ((event.clientY - box.top) / box.height) * 2), this.stage.camera);
  }

  take(event) {
    if (event.button) return;
    this.aim(event);
    const models = Object.values(this.stage.models).filter((model) => model.handle);
    const hit = this.ray.intersectObjects(models.map((model) => model.handle), false)[0];
    if (!hit) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    if (denied(this.stage.element)) return;
    this.model = models.find((model) => model.handle === hit.object);
    this.model.handle.getWorldPosition(this.goal);
    this.plane.setFromNormalAndCoplanarPoint(this.stage.camera.getWorldDirection(new THREE.Vector3()), this.goal);
    this.timer = setInterval(() => this.pull(), 50);
  }

  move(event) {
    if (!this.model) return;
    this.aim(event);
    this.ray.ray.intersectPlane(this.plane, this.goal);
  }

  pull() {
    const { model } = this;
    if (!hasControl()) return this.release();
    model.group.updateWorldMatrix(true, true);
    const base = new THREE.Matrix4().compose(model.at[0], model.base, new THREE.Vector3(1, 1, 1)).premultiply(model.group.matrixWorld);
    const goal = new THREE.Matrix4().compose(this.goal, model.tip.getWorldQuaternion(new THREE.Quaternion()), new THREE.Vector3(1, 1, 1)).premultiply(base.invert());
    const [position, turn] = [new THREE.Vector3(), new THREE.Quaternion()];
    goal.decompose(position, turn, new THREE.Vector3());
    say({ op: "call", to: "boards", command: "pull_tip", values: [...position.toArray(), ...turn.toArray()], text: model.robot });
  }

  release() {
    if (!this.model) return;
    clearInterval(this.timer);
    say({ op: "call", to: "boards", command: "release_tip", values: [], text: this.model.robot });
    this.model = null;
  }
}

// All arms of a system, or one of them with a preview; the element names them (data-drawn, procs/gui/pages/scene.py).
class Stage {
  constructor(element) {
    this.element = element;
    Object.assign(this, JSON.parse(element.dataset.drawn));
    const canvas = element.querySelector("canvas");
    this.names = element.querySelector(".names");
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight("#ffffff", "#8896a4", 2.2));
    const sun = new THREE.DirectionalLight("#ffffff", 1.8);
    sun.position.set(1, -2, 3);
    this.scene.add(sun);
    this.grid = new THREE.GridHelper(4, 40).rotateX(Math.PI / 2);
    this.scene.add(this.grid);
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.01, 50);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.later());
    this.controls.addEventListener("start", () => (this.view = ""));
    this.models = {};
    this.setups = {};
    for (const [name, drawn] of Object.entries(this.arms)) {
      const colours = COLOURS[drawn.type] || COLOURS.PSM;
      const model = new ArmModel(name, drawn, colours[drawn.colour % colours.length], false);
      model.type = drawn.type;
      if (drawn.robot && !this.only) {
        model.robot = drawn.robot;
        model.handle = new THREE.Mesh(HANDLE, new THREE.MeshStandardMaterial({ color: "#ffffff", transparent: true, opacity: 0.35 }));
        model.tip.add(model.handle);
      }
      model.label = Object.assign(document.createElement("span"), { textContent: name });
      this.names.append(model.label);
      model.walls = new WallModels();
      model.group.add(model.walls.group);
      this.scene.add(model.group);
      this.models[name] = model;
      if (this.only) {
        this.ghost = new ArmModel(name, drawn, GHOST, true);
        this.ghost.group.visible = false;
        model.group.add(this.ghost.group);
      }
    }
    this.hand = new Hand(this);
    canvas.addEventListener("pointerdown", (event) => this.hand.take(event), true); // before the camera's controls
    window.addEventListener("pointermove", (event) => this.hand.move(event));
    for (const name of ["pointerup", "pointercancel", "blur", "pagehide"]) window.addEventListener(name, () => this.hand.release());
    new ResizeObserver(() => this.fit()).observe(element);
    element.stage = this;
    this.fit();
    onTick(() => this.refresh());
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (this.isPlaced && this.view) this.look(this.view); // unless a person has turned it
    this.later();
  }

  refresh() {
    const { arms: found, carts, shown, walls } = data("scene") || {};
    if (this.isOfPast !== isPast()) for (const model of Object.values(this.models)) model.count = 0; // no trail from one time to another
    this.isOfPast = isPast();
    for (const [name, model] of Object.entries(this.models)) if (!found?.[name]) model.group.visible = false; // nothing is known of it
    if (!this.only) this.carts(carts);
    this.ask(shown);
    if (!found) return this.later();
    let apart = 0;
    for (const [name, model] of Object.entries(this.models)) {
      const arm = found[name];
      if (!arm) continue;
      model.show(arm);
      const at = walls?.[name]?.at;
      if (arm.frames.length) model.walls.show(walls?.[name] ?? {}, arm.frames, this.models);
      const label = arm.late ? `${name}: ${arm.age} s old` : at ? `${name}: at wall ${at}` : name;
      if (model.label.textContent !== label) model.label.textContent = label;
      const parent = this.only ? null : this.models[arm.frame];
      if (parent && parent !== model) {
        parent.tip.updateWorldMatrix(true, false);
        model.group.matrix.copy(parent.tip.matrixWorld);
      } else if (this.carried?.[name] && arm.frame === `${name}_base`) {
        // Its poses are in its own base so far, and that is where its setup arm ends.
        const [x, y, z, ...turn] = this.carried[name];
        model.group.matrix.compose(new THREE.Vector3(x, y, z), new THREE.Quaternion(...turn), new THREE.Vector3(1, 1, 1));
      } else {
        model.group.matrix.copy(rooted(arm.frame));
        if (arm.frame === "HRSV" && this.beside) model.group.matrix.setPosition(this.beside);
        else if (!["HRSV", "ECM", "Cart"].includes(arm.frame)) model.group.matrix.setPosition(0.45 * apart++, 0, 0);
      }
      model.group.matrixAutoUpdate = false;
      model.group.matrixWorldNeedsUpdate = true;
    }
    this.shown = (this.shown || 0) + 1;
    if (this.shown === 3) { // by then each arm is placed on the one that carries its frame
      this.place();
      this.look("all");
      this.isPlaced = true;
      this.dress();
    }
    this.later();
  }

  // Meshes come after the page is up: they may be large.
  async dress() {
    if (!this.meshes.names.length) return;
    const { dress } = await import("./meshes.js");
    await dress(this);
  }

  // Carts are in the frame "Cart", the reference of the arms mounted on them.
  carts(found) {
    this.carried = {};
    for (const [cart, arms] of Object.entries(found || {})) {
      for (const arm of Object.values(arms)) if (arm.carries) this.carried[arm.carries] = arm.frames.slice(-7);
      const isNew = !this.setups[cart] && Object.keys(arms).length;
      if (isNew) this.setups[cart] = Object.fromEntries(Object.keys(arms).map((name) => [name, new SetupModel(false)]));
      for (const [name, arm] of Object.entries(arms)) this.setups[cart][name].show(arm);
      if (!isNew) continue;
      const setups = Object.values(this.setups[cart]);
      const parts = [...setups.map((setup) => setup.group), column(setups)];
      for (const part of parts) part.userData.cart = cart;
      this.stands = [...(this.stands || []), ...parts];
      this.scene.add(...parts);
    }
    this.known = Object.keys(found || {}).filter((cart) => Object.keys(found[cart]).length);
    this.stand();
  }

  // Carts are hidden in the endoscope's view, and where nothing is known of them.
  stand() {
    for (const part of this.stands || []) part.visible = !this.isWithin && this.known.includes(part.userData.cart);
  }

  // A pose to which a person is asked to bring an arm: a ghost of it, for as long as the asking program shows it.
  ask(shown) {
    if (this.asked && this.asked.name !== shown?.name) {
      this.asked.group.removeFromParent();
      this.asked.label.remove();
      this.asked = null;
    }
    const own = shown && this.models[shown.name];
    if (!own && (!shown?.name.includes("/") || this.only)) return;
    if (!this.asked) {
      this.asked = own ? new ArmModel(shown.name, this.arms[shown.name], GHOST, true) : new SetupModel(true);
      this.asked.name = shown.name;
      this.asked.label = Object.assign(document.createElement("span"), { className: "asked", textContent: `bring ${shown.name} here` });
      this.names.append(this.asked.label);
      (own ? own.group : this.scene).add(this.asked.group);
    }
    this.asked.show({ frames: shown.frames, jaw: null, state: "ENABLED" });
  }

  // Points of some models, and of the carts, that must be visible.
  points(wanted, whole) {
    this.scene.updateMatrixWorld(true);
    const found = [];
    for (const setups of whole ? Object.values(this.setups) : []) {
      found.push(new THREE.Vector3(0, 0, 0)); // position of its column
      for (const setup of Object.values(setups)) found.push(...setup.at);
    }
    for (const model of Object.values(this.models).filter(wanted)) {
      for (const at of model.at) found.push(at.clone().applyMatrix4(model.group.matrixWorld));
      if (model.size) for (const part of [model.rail, model.carriage]) found.push(...corners(part));
    }
    for (const at of (whole && this.asked?.at) || []) found.push(at.clone().applyMatrix4(this.asked.group.matrixWorld));
    return found;
  }

  // Masters are placed beside the patient's side: the console's position in the room is unknown.
  place() {
    const [masters, others] = [true, false].map((are) => new THREE.Box3().setFromPoints(this.points((model) => (model.type === "MTM") === are)));
    if (masters.isEmpty() || others.isEmpty()) return;
    this.beside = new THREE.Vector3(others.min.x - masters.max.x - (Object.keys(this.setups).length ? 0.5 : 0.25), 0, 0);
    this.beside.y = others.getCenter(new THREE.Vector3()).y - masters.getCenter(new THREE.Vector3()).y;
    this.beside.z = others.getCenter(new THREE.Vector3()).z - masters.getCenter(new THREE.Vector3()).z;
    this.refresh();
  }

  look(view) {
    this.view = view;
    const points = this.points((model) => (view === "masters" ? model.type === "MTM" : view === "all" || model.type !== "MTM" || this.only), view === "all");
    if (!points.length) return;
    const box = new THREE.Box3().setFromPoints(points);
    const centre = box.getCenter(new THREE.Vector3());
    const facing = Object.keys(this.setups).length ? -1 : 1; // a cart is seen from the patient's side
    this.grid.position.z = facing < 0 ? -0.002 : box.min.z - 0.03; // the floor, as far as one knows
    const from = { all: facing < 0 ? [0.7, 1.1, 0.35] : [0.35, -1.2, 0.45], masters: [-0.9, -1.1, 0.6], side: [1, 0, 0.05], top: [0, -0.02, 1], front: [0, -facing, 0.15] };
    const ecm = Object.values(this.models).find((model) => model.type === "ECM") || Object.values(this.models).find((model) => model.type === "PSM");
    // The endoscope's view, from slightly behind: without itself, the masters and the cart.
    this.isWithin = view === "operator";
    this.stand();
    for (const model of Object.values(this.models)) model.isHidden = view === "operator" && ["ECM", "MTM"].includes(model.type);
    const tips = Object.values(this.models).filter((model) => model.type === "PSM" && model.size).map((model) => model.tip.getWorldPosition(new THREE.Vector3()));
    if (view === "operator" && ecm && tips.length) {
      const matrix = ecm.type === "ECM" ? ecm.tip.matrixWorld : ecm.group.matrixWorld;
      this.controls.target.set(0, 0, 0);
      for (const tip of tips) this.controls.target.addScaledVector(tip, 1 / tips.length);
      const ahead = new THREE.Vector3(0, 0, 1).transformDirection(matrix);
      this.camera.position.copy(this.controls.target).addScaledVector(ahead, -0.3);
    } else {
      this.controls.target.copy(centre);
      const way = new THREE.Vector3(...(from[view] || from.all)).normalize();
      this.camera.position.copy(way).multiplyScalar(MARGIN * this.distanceTo(points, centre, way)).add(centre);
    }
    this.controls.update();
    this.later();
  }

  // How far from the centre the camera must be, that way, to have all points in the picture.
  distanceTo(points, centre, way) {
    const right = new THREE.Vector3().crossVectors(this.camera.up, way).normalize();
    const up = new THREE.Vector3().crossVectors(way, right);
    const high = Math.tan((this.camera.fov * Math.PI) / 360);
    const wide = high * this.camera.aspect;
    return Math.max(NEAREST, ...points.map((point) => {
      const at = point.clone().sub(centre);
      return at.dot(way) + Math.max(Math.abs(at.dot(up)) / high, Math.abs(at.dot(right)) / wide);
    }));
  }

  preview(frames, jaw) {
    if (!this.ghost) return;
    this.ghost.group.visible = Boolean(frames);
    if (frames) this.ghost.show({ frames, jaw, state: "ENABLED" });
    const own = this.models[this.only];
    if (frames && own.size === this.ghost.size && own.at.every((at, i) => at.distanceTo(this.ghost.at[i]) < 0.0005)) this.ghost.group.visible = false; // there already
    this.later();
  }

  later() {
    if (this.planned) return;
    this.planned = true;
    requestAnimationFrame(() => {
      this.planned = false;
      this.draw();
    });
  }

  draw() {
    const dark = document.documentElement.dataset.theme === "dark";
    if (this.isDark !== dark) {
      this.isDark = dark;
      this.scene.background = new THREE.Color(dark ? "#151c24" : "#e9eef3");
      this.grid.material.color.set(dark ? "#33404d" : "#c3ccd5");
      this.grid.material.vertexColors = false;
      this.grid.material.needsUpdate = true;
    }
    this.renderer.render(this.scene, this.camera);
    const { clientWidth: width, clientHeight: height } = this.element;
    const at = new THREE.Vector3();
    for (const model of [...Object.values(this.models), ...(this.asked ? [this.asked] : [])]) {
      at.copy(model.carriage?.position ?? model.at.at(-1)).applyMatrix4(model.group.matrixWorld).project(this.camera);
      model.label.hidden = at.z > 1 || !model.group.visible;
      model.label.style.transform = `translate(${((at.x + 1) / 2) * width + 12}px, ${((1 - at.y) / 2) * height - 24}px)`;
    }
  }
}

// At once, before the page has control: without a graphics card this takes longer than a page may be silent.
for (const element of document.querySelectorAll(".stage")) {
  try {
    new Stage(element);
  } catch (error) {
    element.textContent = `No 3D in this browser: ${error.message}`;
  }
}
