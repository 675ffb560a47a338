// Frames and walls in the rest of the page: tables and sentences name them, pictures are pressed where they are.
function linkNames(scene, choose) {
  const known = { frame: (i) => i < scene.frames.length, wall: (i) => scene.wallOfFace[i] !== undefined };
  for (const kind of ["frame", "wall"])
    for (const name of document.querySelectorAll(`[data-${kind}]:not(img)`)) {
      const number = Number(name.dataset[kind]);
      if (!known[kind](number)) continue;
      const button = document.createElement("button");
      Object.assign(button, { type: "button", className: "view-link", textContent: name.textContent });
      button.title = `show this ${kind}`;
      button.addEventListener("click", () => choose[kind](kind === "wall" ? scene.wallOfFace[number] : number));
      name.replaceChildren(button);
    }
}

// What a picture's pixel means is told by its data-clicks: the box of its axes as shares of the picture
// (left, top, right, bottom), and the values at their rims.
function linkPictures(scene, choose) {
  for (const picture of document.querySelectorAll("svg[data-clicks]")) {
    const { kind, box, x, y, side } = JSON.parse(picture.dataset.clicks);
    picture.classList.add("view-pressable");
    const title = document.createElementNS(picture.namespaceURI, "title");
    title.textContent = "press to see the frame";
    picture.prepend(title);
    picture.addEventListener("click", (event) => {
      const rim = picture.getBoundingClientRect();
      const u = ((event.clientX - rim.left) / rim.width - box[0]) / (box[2] - box[0]);
      const v = ((event.clientY - rim.top) / rim.height - box[1]) / (box[3] - box[1]);
      if (u < -0.02 || u > 1.02 || v < -0.02 || v > 1.02) return;
      const along = x[0] + u * (x[1] - x[0]);
      if (kind === "frames") return choose.frame(Math.max(0, Math.min(scene.frames.length - 1, Math.round(along))));
      const [px, py] = [along - scene.origin[0], y[1] + v * (y[0] - y[1]) - scene.origin[1]];
      const frame = nearestFrame(scene, px, py, side === "after" ? 1 : 0);
      if (frame !== null) choose.frame(frame);
    });
  }
}

// The map of walls as built: the wall that is pressed, or the nearest within a finger's breadth.
function linkMap(scene, choose) {
  for (const svg of document.querySelectorAll(".as-built svg")) {
    svg.classList.add("view-pressable");
    svg.addEventListener("click", (event) => {
      const matrix = svg.getScreenCTM();
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
      const [x, y] = [Number(svg.dataset.left) + at.x, Number(svg.dataset.top) - at.y];
      const own = scene.wallOfFace[event.target.closest("[data-face]")?.dataset.face];
      const wall = own ?? nearestWall(scene, x - scene.origin[0], y - scene.origin[1], 12 / matrix.a);
      if (wall !== null) choose.wall(wall);
    });
  }
}
