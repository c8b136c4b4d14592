// The object on a page of its own: drag to turn it, or its lamp. Bundled with three.js into page.min.js; see page.py.
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const TURN = 1.2; // radians to either side: a surface seen from one side has no back
const LAMP = Math.PI; // irradiance at which white paint that faces the lamp is white

const data = JSON.parse(document.getElementById("data").textContent);
const said = document.getElementById("said");
const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

try {
  main();
} catch (error) {
  said.textContent = `This browser cannot draw the object (${error.message}). Another one with WebGL 2 can.`;
}

function main() {
  const canvas = document.getElementById("canvas");
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
  renderer.toneMapping = THREE.NoToneMapping;
  renderer.shadowMap.enabled = true;
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(30, 1, 0.1, 100);
  camera.position.set(0, 0, 4.6);

  const room = new THREE.DataTexture(new Uint16Array(bytes(data.room).buffer), data.width, data.height,
    THREE.RGBAFormat, THREE.HalfFloatType);
  room.mapping = THREE.EquirectangularReflectionMapping;
  room.magFilter = room.minFilter = THREE.LinearFilter;
  room.wrapS = THREE.RepeatWrapping;
  room.needsUpdate = true;
  const around = new THREE.PMREMGenerator(renderer);
  scene.environment = around.fromEquirectangular(room).texture;

  const lamp = new THREE.DirectionalLight(0xffffff, LAMP);
  lamp.castShadow = true;
  lamp.shadow.mapSize.set(1024, 1024);
  lamp.shadow.normalBias = 0.02;
  Object.assign(lamp.shadow.camera, { left: -1.2, right: 1.2, top: 1.2, bottom: -1.2, near: 1, far: 9 });
  scene.add(lamp);

  const turning = new OrbitControls(camera, canvas);
  turning.enablePan = false;
  turning.enableDamping = true;
  Object.assign(turning, { minAzimuthAngle: -TURN, maxAzimuthAngle: TURN, minPolarAngle: Math.PI / 2 - TURN,
    maxPolarAngle: Math.PI / 2 + TURN, minDistance: 2.2, maxDistance: 9 });

  // Where the lamp stands, as on a half sphere before the object; given in the address as #lamp=x,y&room=0.5
  const asked = new URLSearchParams(location.hash.slice(1));
  const at = (asked.get("lamp") || "-0.5,0.6").split(",").map(Number);
  const sliders = { room: document.getElementById("room"), lamp: document.getElementById("lamp") };
  for (const name of ["room", "lamp"]) {
    if (asked.has(name === "lamp" ? "power" : name)) sliders[name].value = asked.get(name === "lamp" ? "power" : name);
    sliders[name].addEventListener("input", draw);
  }
  function put(x, y) {
    const r = Math.hypot(x, y), by = r > 1 ? 1 / r : 1;
    [at[0], at[1]] = [x * by, y * by];
    lamp.position.set(at[0], at[1], Math.sqrt(Math.max(1 - at[0] ** 2 - at[1] ** 2, 0.0025))).multiplyScalar(5);
    draw();
  }

  const moves = document.getElementById("moves");
  moves.addEventListener("change", () => (turning.enabled = moves.value === "object"));
  let held = false;
  const follow = (event) => {
    const box = canvas.getBoundingClientRect(), half = Math.min(box.width, box.height) / 2;
    put((event.clientX - box.left - box.width / 2) / half, -(event.clientY - box.top - box.height / 2) / half);
  };
  canvas.addEventListener("pointerdown", (event) => {
    held = moves.value === "lamp" || event.shiftKey;
    turning.enabled = !held && moves.value === "object";
    if (held) follow(event);
  }, true);
  addEventListener("pointermove", (event) => held && follow(event));
  addEventListener("pointerup", () => {
    held = false;
    turning.enabled = moves.value === "object";
  });
  addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (way && event.target.tagName !== "INPUT" && event.target.tagName !== "SELECT") {
      put(at[0] + 0.08 * way[0], at[1] + 0.08 * way[1]);
      event.preventDefault();
    }
  });

  function draw() {
    scene.environmentIntensity = 2 ** sliders.room.value * (sliders.room.value > sliders.room.min);
    lamp.intensity = LAMP * 2 ** sliders.lamp.value * (sliders.lamp.value > sliders.lamp.min);
    renderer.render(scene, camera);
  }
  function fit() {
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(canvas.clientWidth, canvas.clientHeight, false);
    camera.aspect = canvas.clientWidth / canvas.clientHeight;
    camera.fov = camera.aspect < 1 ? (2 * Math.atan(Math.tan(Math.PI / 12) / camera.aspect) * 180) / Math.PI : 30;
    camera.updateProjectionMatrix();
    draw();
  }
  addEventListener("resize", fit);
  turning.addEventListener("change", draw);

  // Textures come as pictures in the address itself: a page from disk may fetch nothing, not even of its own.
  const picture = (name, space) => new Promise((done, failed) =>
    new THREE.TextureLoader().load(`data:image/png;base64,${data[name]}`, (texture) => {
      texture.flipY = false;
      texture.colorSpace = space;
      texture.anisotropy = renderer.capabilities.getMaxAnisotropy();
      done(texture);
    }, undefined, () => failed(new Error(name))));
  Promise.all([picture("albedo", THREE.SRGBColorSpace), picture("material", THREE.NoColorSpace),
    picture("normals", THREE.NoColorSpace)]).then(([map, material, normalMap]) => {
    const geometry = new THREE.BufferGeometry();
    for (const [name, size] of [["position", 3], ["normal", 3], ["tangent", 4], ["uv", 2]])
      geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(bytes(data[name]).buffer), size));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(data.index).buffer), 1));
    geometry.computeBoundingSphere();
    const { center, radius } = geometry.boundingSphere;
    geometry.translate(-center.x, -center.y, -center.z).scale(1 / radius, 1 / radius, 1 / radius);
    const object = new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ map, normalMap, roughnessMap: material,
      metalnessMap: material, roughness: 1, metalness: data.metalness, side: THREE.DoubleSide }));
    object.castShadow = object.receiveShadow = true;
    scene.add(object);
    put(at[0], at[1]);
    fit();
    document.body.dataset.drawn = "yes";
    const step = () => {
      turning.update();
      requestAnimationFrame(step);
    };
    step();
  }).catch((error) => (said.textContent = `The object could not be read (${error.message}).`));
}
