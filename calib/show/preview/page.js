// Around meshcat's viewer: the drawing, a camera that shows all of it, the legend, the
// layers' switches, words at their places, and the links of the node that is clicked.
"use strict";
(() => {
  const THREE = MeshCat.THREE;
  const element = (id) => document.getElementById(id);
  const data = JSON.parse(element("calib-data").textContent);
  const pane = element("meshcat-pane");

  const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  pane.appendChild(renderer.domElement);
  const viewer = new MeshCat.Viewer(pane, true, renderer);
  const still = window.matchMedia("(prefers-reduced-motion: reduce)").matches;

  // ------------------------------------------------------------------ what is drawn
  // bytes of a base64 text
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const floats = (text) => new Float32Array(bytes(text).buffer);
  // three.js forgets the field of view in the size of a dot
  const dotted = 1 / Math.tan((data.camera.fov * Math.PI) / 360);
  const KINDS = {
    lines: [THREE.LineSegments, THREE.LineBasicMaterial],
    points: [THREE.Points, THREE.PointsMaterial],
    image: [THREE.Mesh, THREE.MeshBasicMaterial],
    marker: [THREE.Mesh, THREE.MeshBasicMaterial],
    sphere: [THREE.Mesh, THREE.MeshPhongMaterial],
    cylinder: [THREE.Mesh, THREE.MeshPhongMaterial],
  };
  const SOLIDS = {
    sphere: (size) => new THREE.SphereGeometry(size[0], 24, 16),
    cylinder: (size) => new THREE.CylinderGeometry(size[0], size[0], size[1], 28),
    marker: (radius) => new THREE.SphereGeometry(radius, 24, 16),
  };

  function shape(drawn) {
    if (drawn.kind in SOLIDS) return SOLIDS[drawn.kind](drawn.size);
    const geometry = new THREE.BufferGeometry();
    const set = (name, array, width, normalized) =>
      geometry.setAttribute(name, new THREE.BufferAttribute(array, width, normalized));
    set("position", drawn.places ? new Float32Array(drawn.places) : floats(drawn.points), 3);
    if (drawn.tints) set("color", bytes(drawn.tints), 3, true);
    if (drawn.image) set("uv", floats(drawn.uv), 2);
    if (drawn.index) {
      const whole = new Uint32Array(bytes(drawn.index).buffer);
      geometry.setIndex(new THREE.BufferAttribute(whole, 1));
    }
    return geometry;
  }

  function draw(drawn) {
    const [Kind, Material] = KINDS[drawn.kind];
    const { opacity, kind } = drawn;
    const look = { color: drawn.colour || "#ffffff", vertexColors: Boolean(drawn.tints) };
    if (kind === "points") look.size = drawn.size * dotted;
    else Object.assign(look, { side: THREE.DoubleSide, opacity, transparent: opacity < 1 });
    // what is seen through must not hide what is drawn after it
    if (opacity < 1) look.depthWrite = false;
    if (kind === "marker") Object.assign(look, { transparent: true, depthTest: false, depthWrite: false });
    if (kind === "image") {
      look.map = new THREE.TextureLoader().load(drawn.image, () => viewer.set_dirty());
    }
    const object = new Kind(shape(drawn), new Material(look));
    object.renderOrder = kind === "image" ? -1 : drawn.order || 0;
    object.castShadow = object.receiveShadow = true;
    viewer.set_object(drawn.path.split("/"), object);
  }

  function track(path, text) {
    const [matrix, place, turn, size] =
      [new THREE.Matrix4(), new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
    const values = floats(text);
    const [places, turns] = [[], []];
    for (let time = 0; time < values.length / 16; time += 1) {
      matrix.fromArray(values, 16 * time).decompose(place, turn, size);
      places.push({ time: data.step * time, value: place.toArray() });
      turns.push({ time: data.step * time, value: turn.toArray() });
    }
    const tracks = [
      { name: ".position", type: "vector3", keys: places },
      { name: ".quaternion", type: "quaternion", keys: turns },
    ];
    return { path: path.split("/"), clip: { fps: 30, name: "default", tracks } };
  }

  data.objects.forEach(draw);
  data.objects = null;
  for (const [path, matrix] of Object.entries(data.places)) {
    viewer.set_transform(path.split("/"), matrix);
  }
  for (const { name, shown } of data.layers) {
    if (!shown) viewer.set_property([name], "visible", false);
  }
  // meshcat's grid lies in z = 0 and cuts a tilted plane's maps
  viewer.set_property(["Grid"], "visible", false);
  const tracks = Object.entries(data.tracks).map(([path, text]) => track(path, text));
  viewer.set_animation(tracks, { play: true, repetitions: 3 });
  element("calib-play").addEventListener("click", () => {
    viewer.animator.reset();
    viewer.animator.play();
  });

  // the page's own ground shows through, light or dark: one full picture less to paint
  viewer.set_property(["Background"], "visible", false);

  // meshcat's z is up, three.js's is y
  const space = (p) => new THREE.Vector3(p[0], p[2], -p[1]);
  let moved = false;

  // the panel covers the left of a wide window: the picture is centred in the rest
  const covered = () => (window.innerWidth >= 720 ? 280 : 0);

  function fit() {
    const [width, height] = [window.innerWidth, window.innerHeight];
    viewer.set_3d_pane_size(width, height);
    viewer.camera.setViewOffset(width, height, -covered() / 2, 0, width, height);
    if (!moved) {
      const { target, direction, half, fov, margin } = data.camera;
      const slope = Math.tan((fov * Math.PI) / 360);
      const aspect = (width - covered()) / height;
      const side = margin * Math.max(half[1], half[0] / aspect);
      const distance = side / slope + half[2];
      viewer.camera.fov = fov;
      viewer.controls.target.copy(space(target));
      viewer.camera.position.copy(space(target)).addScaledVector(space(direction), distance);
      viewer.camera.near = distance / 200;
      viewer.camera.far = distance * 50;
      viewer.controls.update();
    }
    viewer.set_dirty();
  }
  window.addEventListener("resize", fit);
  viewer.controls.addEventListener("start", () => { moved = true; });

  // ------------------------------------------------------------------ panel
  const make = (tag, text, parent) => {
    const node = document.createElement(tag);
    if (text) node.textContent = text;
    parent.appendChild(node);
    return node;
  };
  document.title = `${data.title}: what calib has learned`;
  element("calib-title").textContent = data.title;
  element("calib-bound").textContent = data.bound;
  const gradient = (angle, colours) => `linear-gradient(${angle}, ${[...colours, colours.at(-1)].join(",")})`;
  element("calib-scale").style.background = gradient("to right", data.stops);
  for (const [, words] of data.ticks) make("span", words, element("calib-ticks"));
  const layer = (name) => viewer.scene_tree.find([name]);
  const boxes = new Map();
  for (const { name, colour, text } of data.layers) {
    const label = make("label", "", make("li", "", element("calib-layers")));
    const box = make("input", "", label);
    box.type = "checkbox";
    box.addEventListener("change", () => {
      layer(name).set_property("visible", box.checked);
      viewer.set_dirty();
    });
    boxes.set(name, box);
    const swatch = make("i", "", label);
    swatch.style.background = colour === "scale" ? gradient("135deg", data.stops) : colour || "#e0853c";
    make("span", name, label);
    make("small", text, label);
  }
  for (const note of data.notes) make("p", note, element("calib-notes"));

  if (still) {
    viewer.animator.pause();
    viewer.animator.reset();
  }

  // ------------------------------------------------------------------ words in the picture
  const labels = data.labels.map(({ layer: name, text, at }) =>
    ({ name, node: make("span", text, element("calib-labels")), at: space(at) }));
  for (const label of labels) label.width = label.node.offsetWidth + 6;
  const screen = (point) => {
    const p = point.clone().project(viewer.camera);
    return [(p.x + 1) * 0.5 * window.innerWidth, (1 - p.y) * 0.5 * window.innerHeight, p.z];
  };
  const render = viewer.render.bind(viewer);
  viewer.render = () => {
    render();
    const boxes_of_words = [];
    for (const { name, node, at, width } of labels) {
      const [x, y, z] = screen(at);
      const box = { left: x - width / 2, right: x + width / 2, top: y - 9, bottom: y + 9 };
      const hidden = boxes_of_words.some((other) => box.left < other.right
        && other.left < box.right && box.top < other.bottom && other.top < box.bottom);
      const shown = layer(name).object.visible && z < 1 && box.left > covered() && !hidden;
      node.style.display = shown ? "" : "none";
      node.style.left = `${x}px`;
      node.style.top = `${y}px`;
      if (shown) boxes_of_words.push(box);
    }
    // meshcat's own controls and ours show the same
    for (const [name, box] of boxes) box.checked = layer(name).object.visible;
  };

  // ------------------------------------------------------------------ links of a node
  const nodes = (name) => viewer.scene_tree.find([name, "nodes", "<object>"]).object;
  const partners = data.links && new Uint32Array(bytes(data.links.partners).buffer);
  const each = data.links && data.links.each;

  function link(node) {
    const from = nodes("Sensory map").geometry.attributes.position;
    const to = nodes("Motor map").geometry.attributes.position;
    const point = (array, i) => [array.getX(i), array.getY(i), array.getZ(i)];
    const start = point(from, node);
    const [lines, dots] = [[], [...start]];
    for (let k = 0; k < each; k += 1) {
      const partner = partners[node * each + k];
      if (partner >= to.count) continue; // none
      const end = point(to, partner);
      lines.push(...start, ...end);
      dots.push(...end);
    }
    const look = { colour: data.links.link, size: 0.022 * data.size, opacity: 1 };
    draw({ path: "Hebbian links/lines", kind: "lines", places: lines, ...look });
    draw({ path: "Hebbian links/nodes", kind: "points", places: dots, ...look });
    data.links.node = node;
    viewer.set_dirty();
  }

  if (data.links) link(data.links.node);

  // where the pointer is, as a ray into the scene
  function rayOf(event) {
    const place = new THREE.Vector2((event.clientX / window.innerWidth) * 2 - 1,
      1 - (event.clientY / window.innerHeight) * 2);
    const ray = new THREE.Raycaster();
    ray.params.Points.threshold = 0.03 * data.size;
    ray.setFromCamera(place, viewer.camera);
    return ray;
  }

  let pressed = null;
  const canvas = renderer.domElement;
  canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    if (!data.links || !pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
    const hits = rayOf(event).intersectObject(nodes("Sensory map"));
    hits.sort((a, b) => a.distanceToRay - b.distanceToRay);
    if (hits.length) link(hits[0].index);
  });

  window.calib = { data, viewer, fit, link, screen: (p) => screen(space(p)) };
  fit();
  requestAnimationFrame(fit);
})();
