// Draws the surface with three.js.

/** What every picture of a surface shares: its shape and its sites. */
function newShape({ vertices, triangles, sites }, siteRadius) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(vertices, 3));
  geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
  geometry.computeVertexNormals();
  const ball = new THREE.SphereGeometry(siteRadius, ...(sites.length > 400 ? [8, 6] : [24, 16]));
  return { geometry, ball };
}

/** A picture on a canvas; throws where there is no WebGL. */
function webglPicture(canvas, surface, shape, view) {
  const { sites } = surface;
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));

  // A vertex has its place in the palette: the first row is the scale, the second is for no value.
  const place = new THREE.BufferAttribute(new Float32Array(2 * surface.vertices.length / 3), 2);
  const geometry = new THREE.BufferGeometry();
  for (const name of ["position", "normal"]) geometry.setAttribute(name, shape.geometry.getAttribute(name));
  geometry.setAttribute("uv", place);
  geometry.setIndex(shape.geometry.getIndex());
  const texels = new Uint8Array(8 * N_COLOURS);
  const palette = new THREE.DataTexture(texels, N_COLOURS, 2);
  palette.colorSpace = THREE.SRGBColorSpace;
  const map = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ map: palette, side: THREE.DoubleSide }));

  const red = new THREE.Color(`rgb(${SITE.join(",")})`);
  const balls = new THREE.InstancedMesh(shape.ball, new THREE.MeshLambertMaterial({ color: red }), sites.length);
  sites.forEach((at, i) => balls.setMatrixAt(i, new THREE.Matrix4().makeTranslation(...at)));

  // Light from the eye: a part of the surface seen from the front has exactly the colour of the legend.
  const eye = new THREE.DirectionalLight(0xffffff, 0.4 * Math.PI);
  const scene = new THREE.Scene();
  scene.add(map, balls, eye, eye.target, new THREE.AmbientLight(0xffffff, 0.6 * Math.PI));

  const render = () => {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    view.frame(width, height);
    eye.position.copy(view.camera.position);
    view.camera.getWorldDirection(eye.target.position).add(eye.position);
    renderer.render(scene, view.camera);
  };

  const paint = ({ values, scale, threshold, showsSites }) => {
    values.forEach((value, vertex) => {
      const isKnown = Number.isFinite(value);
      const share = isKnown ? shareOf(value, scale) : 0;
      // far beyond the edge: a triangle with one corner without a value is grey all over
      place.setXY(vertex, (share * (N_COLOURS - 1) + 0.5) / N_COLOURS, isKnown ? 0.49 : 1e4);
    });
    place.needsUpdate = true;
    texels.set(paletteOf(scale, threshold));
    for (let i = 0; i < N_COLOURS; i++) texels.set([...VOID, 255], 4 * (N_COLOURS + i));
    palette.needsUpdate = true;
    balls.visible = showsSites;
    render();
  };

  const picker = new THREE.Raycaster();
  /** The vertex or the site at a place of the canvas (shares of its width and height). */
  const pick = (x, y) => {
    view.frame(canvas.clientWidth, canvas.clientHeight);
    picker.setFromCamera(new THREE.Vector2(2 * x - 1, 1 - 2 * y), view.camera);
    const hit = picker.intersectObjects(balls.visible ? [map, balls] : [map])[0];
    if (!hit) return {};
    if (hit.object === balls) return { site: hit.instanceId };
    const { a, b, c } = hit.face;
    const distance = (i) => hit.point.distanceTo(new THREE.Vector3().fromArray(surface.vertices, 3 * i));
    return { vertex: [a, b, c].sort((p, q) => distance(p) - distance(q))[0] };
  };

  return { render, paint, pick, draw: render };
}
