// Meshes of the arms' parts, around their rods (procs/gui/meshes.py). three.js has a reader for STL; its reader for COLLADA
// is large. This one reads only the elements that dvrk_model uses: triangles and polylists of positions, in
// the nodes of a scene. That is much less than a further library, for the browser or for the server. The files are from
// outside: the browser loads no external entities, and a broken file leaves only its part without a mesh.
import { note } from "./live.js";
import { STLLoader } from "./three/STLLoader.js";
import * as THREE from "./three/three.module.min.js";

const MAX_TRIANGLES = 2e6; // of a file: nodes can repeat a geometry
const LOOK = { color: "#aab4be", roughness: 0.7, metalness: 0.1, flatShading: true, transparent: true, opacity: 0.4 };

const numbers = (element) => element.textContent.trim().split(/\s+/).map(Number);

const MOVES = {
  matrix: (v) => new THREE.Matrix4().set(...v),
  translate: ([x, y, z]) => new THREE.Matrix4().makeTranslation(x, y, z),
  rotate: ([x, y, z, degrees]) => new THREE.Matrix4().makeRotationAxis(new THREE.Vector3(x, y, z).normalize(), (degrees * Math.PI) / 180),
  scale: ([x, y, z]) => new THREE.Matrix4().makeScale(x, y, z),
};

class Collada {
  constructor(text) {
    this.file = new DOMParser().parseFromString(text, "text/xml");
    this.found = []; // corners of triangles, one after the other
    const scene = this.file.querySelector("visual_scene");
    if (!scene || this.file.querySelector("parsererror")) throw new Error("no COLLADA file with a scene");
    const unit = Number(this.file.querySelector("asset > unit")?.getAttribute("meter") ?? 1);
    this.walk(scene, new THREE.Matrix4().makeScale(unit, unit, unit)); // the axis that is up is ignored, as in RViz
  }

  at(url) {
    return this.file.getElementById((url || "").slice(1));
  }

  walk(node, before) {
    const pose = before.clone();
    for (const child of node.children) {
      if (MOVES[child.localName]) pose.multiply(MOVES[child.localName](numbers(child)));
      else if (child.localName === "node") this.walk(child, pose);
      else if (child.localName === "instance_geometry") for (const part of this.at(child.getAttribute("url")).querySelectorAll("triangles, polylist")) this.add(part, pose);
    }
  }

  add(part, pose) {
    const inputs = [...part.children].filter((child) => child.localName === "input");
    const corners = inputs.find((input) => input.getAttribute("semantic") === "VERTEX");
    const source = this.at(this.at(corners.getAttribute("source")).querySelector("input[semantic=POSITION]").getAttribute("source"));
    const positions = numbers(source.querySelector("float_array"));
    const step = Number(source.querySelector("accessor")?.getAttribute("stride") ?? 3);
    const each = 1 + Math.max(...inputs.map((input) => Number(input.getAttribute("offset"))));
    const indices = numbers(part.querySelector("p")).filter((_, i) => i % each === Number(corners.getAttribute("offset")));
    const point = new THREE.Vector3();
    const take = (i) => this.found.push(...point.fromArray(positions, step * indices[i]).applyMatrix4(pose).toArray());
    const counts = part.querySelector("vcount");
    let first = 0;
    for (const count of counts ? numbers(counts) : new Array(Math.floor(indices.length / 3)).fill(3)) {
      for (let i = 2; i < count; i++) [first, first + i - 1, first + i].forEach(take);
      first += count;
      if (this.found.length > 9 * MAX_TRIANGLES) throw new Error("it has too many triangles");
    }
  }
}

function stl(bytes) {
  const isText = new TextDecoder().decode(bytes.slice(0, 5)) === "solid";
  const count = bytes.byteLength < 84 ? 0 : new DataView(bytes).getUint32(80, true);
  if (!isText && bytes.byteLength < 84 + 50 * count) throw new Error("it ends too early");
  return new STLLoader().parse(bytes);
}

function geometry(name, bytes) {
  const made = /\.dae$/i.test(name) ? new THREE.BufferGeometry() : stl(bytes);
  if (/\.dae$/i.test(name)) made.setAttribute("position", new THREE.Float32BufferAttribute(new Collada(new TextDecoder().decode(bytes)).found, 3));
  const { array } = made.getAttribute("position");
  if (!array.length || !array.every(Number.isFinite)) throw new Error("it has no triangles, or wrong numbers");
  return made;
}

const placed = (object, pose) => {
  object.position.fromArray(pose);
  object.quaternion.fromArray(pose, 3);
  return object;
};

// The parts of one arm; frames of its base and its joints carry them.
class Parts {
  constructor(drawn) {
    this.frames = Array.from({ length: drawn.joints + 1 }, () => new THREE.Group());
    this.parts = drawn.parts.map((part) => placed(new THREE.Group(), part.pose));
    this.drawn = drawn.parts;
    this.turns = this.parts.map((part) => part.quaternion.clone());
    const parents = [...this.frames, ...this.parts];
    this.parts.forEach((part, i) => parents[this.drawn[i].parent].add(part));
  }

  show(arm) {
    this.frames.forEach((frame, i) => placed(frame, arm.frames.slice(7 * i, 7 * i + 7)));
    this.parts.forEach((part, i) => part.quaternion.copy(this.turns[i]) && part.rotateZ(arm.turns?.[i] || 0));
  }

  wear(file, shape, look) {
    this.drawn.forEach((part, i) => {
      for (const mesh of part.meshes) if (mesh.file === file) {
        const made = placed(new THREE.Mesh(shape, look), mesh.pose);
        made.scale.fromArray(mesh.scale);
        this.parts[i].add(made);
      }
    });
  }
}

// Put meshes on all arms of a stage, file by file; those that cannot be shown are reported once, together.
export async function dress(stage) {
  const { names, folder } = stage.meshes;
  const look = new THREE.MeshStandardMaterial(LOOK);
  const worn = new Set();
  const models = Object.entries(stage.models).filter(([name]) => stage.arms[name].parts.length);
  for (const [name, model] of models) {
    model.parts = new Parts(stage.arms[name]);
    model.group.add(...model.parts.frames);
    for (const part of stage.arms[name].parts) for (const mesh of part.meshes) worn.add(mesh.file);
  }
  const wrong = [];
  for (const file of worn) {
    try {
      const answer = await fetch(`${folder}/${file}`);
      if (!answer.ok) throw new Error(await answer.text());
      const shape = geometry(names[file], await answer.arrayBuffer());
      for (const [, model] of models) model.parts.wear(file, shape, look);
      stage.later();
    } catch (error) {
      wrong.push(`${names[file]}: ${error.message}`);
    }
  }
  stage.isDressed = true;
  if (!wrong.length) return;
  console.warn(`meshes that are not shown: ${wrong.join("; ")}`);
  note(stage.element, "bad", `${wrong.length} of ${worn.size} meshes are not shown: ${wrong[0]}`);
}
