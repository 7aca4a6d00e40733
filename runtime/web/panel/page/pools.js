// Many shapes of one kind, drawn at once, and their shadows on the ground. Lengths in m, z up.
import * as THREE from "/three.module.min.js";

const UP = new THREE.Vector3(0, 1, 0), ONE = new THREE.Vector3(1, 1, 1);
const [from, along, turn, matrix, color] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Quaternion(), new THREE.Matrix4(), new THREE.Color()];

export class Pool {
  // tapered: whether each instance has two radii and a half length of its own; otherwise its matrix scales it. shade: its
  // shadows' material; none without.
  constructor(parent, geometry, material, { tapered = false, shade = null } = {}) {
    Object.assign(this, { parent, geometry, material, tapered, shade });
    this.room = this.count = 0;
    this.meshes = [];
    if (tapered) stretched(material);
  }

  begin() { this.count = 0; }

  // Makes room for twice as many.
  grow() {
    const before = this.meshes[0], old = this.size;
    this.room = Math.max(2 * this.room, 32);
    const shape = this.geometry.clone(), made = new THREE.InstancedMesh(shape, this.material, this.room);
    if (this.tapered) {
      this.size = new THREE.InstancedBufferAttribute(new Float32Array(3 * this.room), 3);
      if (old) this.size.array.set(old.array);
      shape.setAttribute("size", this.size);
    }
    made.setColorAt(0, color);
    if (before) {
      made.instanceMatrix.array.set(before.instanceMatrix.array);
      made.instanceColor.array.set(before.instanceColor.array);
      this.parent.remove(...this.meshes);
      before.geometry.dispose();
      before.dispose();
    }
    this.meshes = [made];
    if (this.shade) {
      const shadow = new THREE.InstancedMesh(shape, this.shade, this.room);
      shadow.instanceMatrix = made.instanceMatrix;
      this.meshes.push(shadow);
    }
    for (const mesh of this.meshes) mesh.frustumCulled = false; // its instances are everywhere
    this.changing = [[made.instanceMatrix, 16], [made.instanceColor, 3], ...(this.tapered ? [[this.size, 3]] : [])];
    this.changing.forEach(([attribute]) => attribute.setUsage(THREE.DynamicDrawUsage));
    this.parent.add(...this.meshes);
  }

  // A capsule from a to b, with their radii.
  capsule(a, b, ra, rb, rgb) {
    if (this.count === this.room) this.grow();
    from.fromArray(a);
    along.fromArray(b).sub(from);
    const length = along.length(), there = length > 1e-9;
    turn.setFromUnitVectors(UP, there ? along.divideScalar(length) : UP);
    if (there) from.addScaledVector(along, length / 2);
    this.size.setXYZ(this.count, ra, rb, length / 2);
    this.put(matrix.compose(from, turn, ONE), rgb);
  }

  put(placed, rgb) {
    if (this.count === this.room) this.grow();
    this.meshes[0].setMatrixAt(this.count, placed);
    this.meshes[0].setColorAt(this.count, color.setRGB(rgb[0] / 255, rgb[1] / 255, rgb[2] / 255, THREE.SRGBColorSpace));
    this.count++;
  }

  end() {
    for (const mesh of this.meshes) [mesh.count, mesh.visible] = [this.count, this.count > 0];
    for (const [attribute, each] of this.meshes.length ? this.changing : []) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, each * this.count);
      attribute.needsUpdate = true;
    }
  }
}

// A capsule of radius 1 whose middle part is 2 long, along y: each instance says its radii and half its length.
export function capsuleShape(round) { return new THREE.CapsuleGeometry(1, 2, Math.ceil(round / 4), round, 1); }

const STRETCH = `
  float side = sign(position.y), radius = side > 0.0 ? size.y : size.x;
  vec3 transformed = vec3(position.x * radius, (position.y - side) * radius + side * size.z, position.z * radius);`;
const FLATTEN = `
  vec4 mvPosition = instanceMatrix * vec4(transformed, 1.0);
  mvPosition.xyz -= sun * ((mvPosition.z - floorZ) / sun.z);
  mvPosition = viewMatrix * mvPosition;
  gl_Position = projectionMatrix * mvPosition;`;

function stretched(material, flat = null) {
  material.onBeforeCompile = (shader) => {
    if (flat) Object.assign(shader.uniforms, flat);
    let made = shader.vertexShader;
    if (!flat || flat.tapered) made = made.replace("#include <common>", "#include <common>\nattribute vec3 size;").replace("#include <begin_vertex>", STRETCH);
    if (flat) made = made.replace("#include <common>", "#include <common>\nuniform vec3 sun;\nuniform float floorZ;").replace("#include <project_vertex>", FLATTEN);
    shader.vertexShader = made;
  };
  material.customProgramCacheKey = () => `${Boolean(flat)} ${!flat || flat.tapered}`;
  return material;
}

// What shadows on the ground are drawn with. sun: uniforms of the way to the sun and of the ground's height.
export function shadow(color, uniforms, tapered) {
  const material = new THREE.MeshBasicMaterial();
  material.color = color;
  return stretched(material, { ...uniforms, tapered });
}
