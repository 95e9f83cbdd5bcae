// Walls of an arm in 3D: transparent; orange where the arm's setpoint is near, the denser the nearer; grey where they are off.
import * as THREE from "./three/three.module.min.js";

const AWAY = "#4f9cf0";
const NEAR = "#ff9f1c";
const OFF = "#8a939c";
const FAR = 0.16; // m: how far the endless shapes, plane and cone, are drawn

const MADE = {
  plane: () => new THREE.PlaneGeometry(2 * FAR, 2 * FAR),
  box: ([x, y, z]) => new THREE.BoxGeometry(x, y, z),
  sphere: ([radius]) => new THREE.SphereGeometry(radius, 32, 20),
  cylinder: ([radius, length]) => new THREE.CylinderGeometry(radius, radius, length, 40).rotateX(Math.PI / 2),
  cone: ([half]) => new THREE.ConeGeometry(FAR * Math.sin(half), FAR * Math.cos(half), 48, 1, true).rotateX(-Math.PI / 2).translate(0, 0, (FAR * Math.cos(half)) / 2),
  capsule: ([radius, length]) => new THREE.CapsuleGeometry(radius, length, 8, 32).rotateX(Math.PI / 2).translate(0, 0, length / 2),
};

export class WallModels {
  // In the base of an arm, in the frame of its poses, or at the tip of another arm.
  constructor() {
    this.group = new THREE.Group();
    this.base = new THREE.Group();
    this.group.add(this.base);
    this.drawn = {};
  }

  show({ walls = [] }, frames, models) {
    this.base.position.set(...frames.slice(0, 3));
    this.base.quaternion.set(...frames.slice(3, 7));
    const left = new Set(Object.keys(this.drawn));
    for (const wall of walls) {
      const parent = { base: this.base, reference: this.group }[wall.frame] ?? models[wall.frame]?.tip;
      if (!parent) continue;
      const key = JSON.stringify([wall.name, wall.shape, wall.frame, wall.pose, wall.size]);
      const mesh = (this.drawn[key] ??= this.make(wall, parent));
      left.delete(key);
      const isOff = wall.near === null;
      mesh.material.color.set(isOff ? OFF : wall.near > 0 ? NEAR : AWAY);
      mesh.material.opacity = isOff ? 0.08 : 0.18 + 0.32 * wall.near;
    }
    for (const key of left) {
      this.drawn[key].removeFromParent();
      this.drawn[key].traverse((part) => (part.geometry.dispose(), part.material.dispose()));
      delete this.drawn[key];
    }
  }

  make({ name, shape, pose, size }, parent) {
    const mesh = new THREE.Mesh(MADE[shape](size), new THREE.MeshBasicMaterial({ transparent: true, side: THREE.DoubleSide, depthWrite: false }));
    mesh.name = name;
    mesh.position.set(...pose.slice(0, 3));
    mesh.quaternion.set(...pose.slice(3)).normalize();
    const edges = new THREE.LineSegments(new THREE.EdgesGeometry(mesh.geometry, 30), new THREE.LineBasicMaterial({ color: OFF, transparent: true, opacity: 0.6 }));
    mesh.add(edges);
    parent.add(mesh);
    return mesh;
  }
}
