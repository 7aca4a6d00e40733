// What stands in space, as lit bodies with shadows on a ground (three.js). Lengths in m, z up.
import * as THREE from "/three.module.min.js";
import { OPEN, less } from "/eye.js";
import { made, shade } from "/part.js";
import { Pool, capsuleShape, shadow } from "/pools.js";

const OLD = [120, 128, 136], LOUD = [255, 255, 255], DARK = 120; // a robot's dark parts stay dark
const THEMES = {
  dark: { sky: 0x12181f, ground: 0x27313b, lines: 0x3a4753, light: 2.4, ambient: 1.5 },
  light: { sky: 0xf1f4f7, ground: 0xe3e7ea, lines: 0xc3cad1, light: 2.2, ambient: 1.9 },
};
const NEAR = 0.1, MIDDLE = 0.2; // m, of a distance: what is farther than these is faint, or isn't drawn
const AXES = [[230, 70, 60], [70, 180, 70], [80, 130, 240]]; // x, y, z
const STEPS = [2, 1, 0.8, 0.6]; // pixels of the picture for one of the page, from the best down
const SLOW = 34, LOOK = 45; // ms between frames above which a step down is taken; frames that are looked at
const HELPS = 0.9; // of the time before: a step that takes more of it is taken back
const SUN = [0.5, -0.35, 1.0]; // the way to it: over the left shoulder of whoever looks from the front

export class Solid {
  constructor(canvas, overlay, eye) {
    [this.canvas, this.overlay, this.eye] = [canvas, overlay, eye];
    this.slow = software();
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: !this.slow });
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(30, 1, 0.01, 100);
    this.camera.up.set(0, 0, 1);
    this.sky = new THREE.HemisphereLight(0xffffff, 0x8a8f96, 1);
    this.sky.position.set(0, 0, 1);
    this.sun = new THREE.DirectionalLight(0xffffff, 1);
    this.sun.position.set(...SUN);
    this.ground = new THREE.Mesh(new THREE.CircleGeometry(1, 48), new THREE.MeshBasicMaterial());
    this.grid = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    this.scene.add(this.sky, this.sun, this.ground, this.grid);
    const lit = () => new THREE.MeshLambertMaterial(), clear = { transparent: true, depthWrite: false };
    this.shade = new THREE.Color();
    this.fall = { sun: { value: new THREE.Vector3(...SUN) }, floorZ: { value: 0 } };
    const pool = (shape, material, tapered, shadows) => new Pool(this.scene, shape, material, { tapered, shade: shadows && shadow(this.shade, this.fall, tapered) });
    this.solids = pool(capsuleShape(12), lit(), true, true);
    this.thin = pool(capsuleShape(5), lit(), true, true);
    this.boxes = pool(new THREE.BoxGeometry(2, 2, 2), lit(), false, true);
    this.cylinders = pool(new THREE.CylinderGeometry(1, 1, 2, 20).rotateX(Math.PI / 2), lit(), false, true);
    this.shells = pool(capsuleShape(16), new THREE.MeshLambertMaterial({ ...clear, opacity: 0.35 }), true, false);
    this.faint = pool(capsuleShape(16), new THREE.MeshLambertMaterial({ ...clear, opacity: 0.1 }), true, false);
    this.over = pool(capsuleShape(4), new THREE.MeshBasicMaterial({ ...clear, depthTest: false }), true, false);
    this.pools = [this.solids, this.thin, this.boxes, this.cylinders, this.shells, this.faint, this.over];
    [this.own, this.placed, this.at, this.turned, this.scale] = [new THREE.Matrix4(), new THREE.Matrix4(), new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
    this.tags = [];
    this.step = this.slow ? 1 : 0;
    this.times = [];
    this.before = 0; // ms between frames before the newest step; 0: there was none
    this.settled = false; // whether no further step helps
    this.square = 0;
    this.given = null; // the scene
    this.drawn = { points: 0, links: 0, capsules: 0 };
    const light = matchMedia("(prefers-color-scheme: light)");
    const paint = () => this.paint(THEMES[light.matches ? "light" : "dark"]);
    light.addEventListener("change", paint);
    paint();
    this.quality();
  }

  paint(theme) {
    this.scene.background = new THREE.Color(theme.sky);
    this.scene.fog = new THREE.Fog(theme.sky, 1, 10);
    this.ground.material.color.set(theme.ground);
    this.shade.set(theme.ground).multiplyScalar(0.45);
    this.grid.material.color.set(theme.lines);
    this.sun.intensity = theme.light;
    this.sky.intensity = theme.ambient;
  }

  quality() {
    this.renderer.setPixelRatio(Math.min(devicePixelRatio || 1, STEPS[this.step]));
    this.width = 0; // sized anew
  }

  // Returns whether the picture must be drawn anew. Draws fewer pixels where the browser's frames come too slowly, as long as that helps.
  hurry(now) {
    if (document.hidden) this.times = [];
    this.times.push(now);
    if (this.times.length <= LOOK || this.settled) return false;
    const every = (now - this.times[0]) / LOOK;
    this.times = [];
    if (this.before && every > HELPS * this.before) { // others keep the processors busy
      this.settled = true;
      this.step--;
    } else if (every > SLOW && this.step < STEPS.length - 1) {
      this.before = every;
      this.step++;
    } else return false;
    this.quality();
    return true;
  }

  // given: the scene; values, links, frames: of a frame of the server; live(thing): whether it is of now.
  draw(given, { things: values, links, frames }, live) {
    const { things } = this.given = given;
    this.size();
    const box = { low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] };
    this.drawn = { points: 0, links: 0, capsules: 0 };
    this.bare = things.every((thing) => !thing.points && !thing.parts.length);
    for (const pool of this.pools) pool.begin();
    things.forEach((thing, i) => {
      if (thing.points) this.points(thing, values[i], live(thing), box);
      else if (links[i]) this.robot(thing, links[i], values[i], live(thing), box);
      else this.capsules(thing, values[i], live(thing), box);
    });
    this.eye.aim(box.low, box.high);
    if (!this.eye.target) return; // there is nothing to see
    for (const part of given.scenery) this.part(part, part.color, { low: [...box.low], high: [...box.high] });
    this.axes(frames, given.frames);
    for (const pool of this.pools) pool.end();
    this.lie();
    this.look();
    this.renderer.render(this.scene, this.camera);
  }

  size() {
    const [w, h] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (w === this.width && h === this.height) return;
    [this.width, this.height] = [w, h];
    this.renderer.setSize(w, h, false);
  }

  points(thing, flat, live, box) {
    const color = (row) => (live ? thing.colors[thing.colors.length > 1 ? row : 0] : OLD);
    const [dot, thin] = thing.radii, thick = (row) => thing.thick[row] ?? thin, off = (row) => this.eye.hidden.has(thing.groups[row] ?? thing.said);
    const at = (row) => (flat[3 * row] === null || flat[3 * row + 1] === null || flat[3 * row + 2] === null ? null : flat.slice(3 * row, 3 * row + 3));
    for (const link of thing.links) {
      for (let k = 1; k < link.length; k++) {
        const [i, j] = [link[k - 1], link[k]], a = at(i), b = at(j);
        if (!a || !b || off(i)) continue;
        this.drawn.links++;
        (thick(i) + thick(j) > 0.05 * this.eye.reach ? this.solids : this.thin).capsule(a, b, Math.min(thick(i), 2 * thick(j)), Math.min(thick(j), 2 * thick(i)), color(i));
      }
    }
    for (let row = 0; 3 * row < flat.length; row++) {
      const p = at(row);
      if (!p || off(row)) continue;
      this.drawn.points++;
      const radius = thing.thick[row] ?? dot;
      grow(box, p, radius);
      if (!thing.links.length) this.thin.capsule(p, p, radius, radius, color(row));
    }
  }

  capsules(thing, flat, live, box) {
    const shaded = !thing.colors.length, gap = thing.solid && shaded;
    if (this.eye.hidden.has(thing.said)) return;
    for (let i = 0; i < flat.length; i += 8) {
      if (flat.slice(i, i + 7).includes(null)) continue;
      const [a, b, radius, distance] = [flat.slice(i, i + 3), flat.slice(i + 3, i + 6), flat[i + 6], flat[i + 7]];
      this.drawn.capsules++;
      grow(box, a, radius);
      grow(box, b, radius);
      const far = shaded && !gap && !(distance !== null && distance < NEAR);
      if (far && !this.bare && !(distance !== null && distance < MIDDLE)) continue; // it would hide what is inside
      const pool = gap ? this.over : thing.solid ? this.solids : far ? this.faint : this.shells;
      pool.capsule(a, b, radius, radius, !live ? OLD : gap ? LOUD : thing.colors[0] ?? shade(this.given.ramp, this.given.unknown, distance));
    }
  }

  robot(thing, places, flat, live, box) {
    if (this.eye.hidden.has(thing.said)) return;
    this.drawn.capsules += flat.length / 8;
    const color = (part) => (!live ? OLD : Math.max(...part.color) < DARK ? part.color : thing.colors[0]);
    for (const part of thing.parts) {
      const T = places.slice(12 * part.link, 12 * part.link + 12);
      if (!T.includes(null)) this.part(part, color(part), box, this.placed.set(...T, 0, 0, 0, 1));
    }
  }

  // A box, cylinder, capsule or sphere; on: where the link is that has it.
  part({ kind, size, pose }, rgb, box, on = null) {
    const own = this.own.compose(this.at.fromArray(pose), this.turned.set(pose[4], pose[5], pose[6], pose[3]), this.scale.set(1, 1, 1));
    if (on) own.premultiply(on);
    const [x, y, z] = own.elements.slice(12, 15), s = size;
    grow(box, [x, y, z], Math.max(...s));
    if (kind === "box") this.boxes.put(own.scale(this.scale.fromArray(s)), rgb);
    else if (kind === "cylinder") this.cylinders.put(own.scale(this.scale.set(s[0], s[0], s[1])), rgb);
    else {
      const half = kind === "capsule" ? s[1] : 0, way = own.elements.slice(8, 11);
      const end = (k) => [x + k * half * way[0], y + k * half * way[1], z + k * half * way[2]];
      this.solids.capsule(end(-1), end(1), s[0], s[0], rgb);
    }
  }

  // The frames' axes and names.
  axes(frames, names) {
    const long = 0.12 * this.eye.reach, thin = 0.006 * this.eye.reach;
    const tags = [];
    frames.forEach((T, i) => {
      if (!this.eye.frames || T.includes(null)) return;
      const at = new THREE.Vector3(T[3], T[7], T[11]);
      AXES.forEach((rgb, k) => {
        const end = [0, 4, 8].map((row) => T[row + 3] + long * T[row + k]);
        this.over.capsule(at.toArray(), end, thin, thin, rgb);
      });
      tags.push([names[i], at]);
    });
    while (this.tags.length > tags.length) this.tags.pop().remove();
    while (this.tags.length < tags.length) this.tags.push(this.overlay.appendChild(made("span", "tag")));
    this.tagged = tags;
  }

  // The ground and its squares, below all there is.
  lie() {
    const { eye, ground, grid } = this, r = Math.max(eye.reach, 0.05), middle = eye.target || [0, 0, 0], square = nice(r / 2);
    this.fall.floorZ.value = eye.floor - 0.001 * r;
    ground.position.set(middle[0], middle[1], eye.floor - 0.003 * r);
    ground.scale.setScalar(30 * r);
    if (square !== this.square) this.squares(square);
    grid.position.set(Math.round(middle[0] / square) * square, Math.round(middle[1] / square) * square, eye.floor - 0.002 * r);
  }

  squares(square) {
    this.square = square;
    const most = 20 * square, lines = [];
    for (let i = -20; i <= 20; i++) lines.push(i * square, -most, 0, i * square, most, 0, -most, i * square, 0, most, i * square, 0);
    this.grid.geometry.dispose();
    this.grid.geometry = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(lines, 3));
    this.grid.frustumCulled = false;
  }

  look() {
    const { camera, eye } = this, aspect = Math.max(this.width, 1) / Math.max(this.height, 1), far = eye.distance || 1;
    const half = Math.tan(OPEN / 2) / Math.min(aspect, 1);
    camera.fov = 2 * Math.atan(half) * 180 / Math.PI;
    [camera.aspect, camera.near, camera.far] = [aspect, Math.max(far / 100, 0.001), 40 * Math.max(far, eye.reach)];
    camera.position.set(...eye.place());
    camera.lookAt(...eye.middle());
    camera.updateProjectionMatrix();
    [this.scene.fog.near, this.scene.fog.far] = [1.5 * far, 6 * far];
    camera.updateMatrixWorld();
    const taken = [];
    this.tags.forEach((tag, i) => {
      const [name, at] = this.tagged[i], p = at.clone().project(camera), place = [(p.x + 1) / 2 * this.width, (1 - p.y) / 2 * this.height];
      while (taken.some(([x, y]) => Math.abs(x - place[0]) < 70 && Math.abs(y - place[1]) < 14)) place[1] += 14;
      taken.push(place);
      if (tag.textContent !== name) tag.textContent = name;
      tag.style.transform = `translate(${place[0]}px, ${place[1]}px)`;
      tag.hidden = p.z > 1;
    });
  }
}

function grow({ low, high }, p, radius) {
  for (let i = 0; i < 3; i++) [low[i], high[i]] = [Math.min(low[i], p[i] - radius), Math.max(high[i], p[i] + radius)];
}

function nice(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  return power * [1, 2, 5, 10].find((k) => k * power >= length * 0.999);
}

// Whether the browser draws without a graphics card.
function software() {
  const gl = document.createElement("canvas").getContext("webgl2"), said = gl && gl.getExtension("WEBGL_debug_renderer_info");
  const name = said ? gl.getParameter(said.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
