// The card that tells of the chosen frame or wall: inside the view where that is on the screen, else at the
// lower rim of the window.
class Card {
  constructor(scene, element, actions) {
    Object.assign(this, { scene, element, actions });
    this.numbers = Object.keys(scene.pictures).map(Number);
  }

  close() {
    this.element.hidden = true;
  }

  open(title, parts) {
    const head = document.createElement("h3");
    head.textContent = title;
    this.element.replaceChildren(this.button("\u00d7", "close", this.actions.close), head, ...parts);
    this.element.querySelector("button").className = "view-close";
    this.element.hidden = false;
  }

  button(words, label, action) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = words;
    if (label) button.setAttribute("aria-label", label);
    button.addEventListener("click", action);
    return button;
  }

  list(rows) {
    const list = document.createElement("dl");
    for (const [name, words] of rows) {
      const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
      [dt.textContent, dd.textContent] = [name, words];
      list.append(dt, dd);
    }
    return list;
  }

  row(...buttons) {
    const row = document.createElement("div");
    row.className = "view-buttons";
    row.append(...buttons);
    return row;
  }

  showFrame(i) {
    const { scene } = this;
    const frame = scene.frames[i];
    const at = placed(scene, i, [0, 0, 0], 1).map((v, axis) => v + scene.origin[axis]);
    const rows = [
      ["Place", `x ${at[0].toFixed(2)}, y ${at[1].toFixed(2)}, height ${at[2].toFixed(2)} m`],
      ["Moved by", frame.moved],
      ["May be off by", frame.predicted],
    ];
    if (frame.time) rows.push(["Time", frame.time]);
    const parts = [...this.picture(i), this.list(rows.filter(([, words]) => words))];
    const last = scene.frames.length - 1;
    const step = (by) => () => this.actions.chooseFrame(Math.max(0, Math.min(last, i + by)));
    parts.push(this.row(
      this.button("\u2039", "previous frame", step(-1)), this.button("\u203a", "next frame", step(1)),
      this.button("look from here", "", () => this.actions.lookFrom(i)), this.showButton(),
    ));
    this.open(frame.id === String(i) ? `Frame ${i}` : `Frame ${i} (${frame.id})`, parts);
  }

  showButton() {
    const button = this.button("show in 3D", "", this.actions.show);
    button.className = "view-show";
    return button;
  }

  picture(i) {
    if (!this.numbers.length) return [];
    const nearest = this.numbers.reduce((a, b) => (Math.abs(b - i) < Math.abs(a - i) ? b : a));
    const image = document.createElement("img");
    image.src = `data:image/jpeg;base64,${this.scene.pictures[nearest]}`;
    image.alt = `What frame ${nearest} sees`;
    image.dataset.frame = nearest;
    if (nearest === i) return [image];
    const words = document.createElement("small");
    words.textContent = `The page holds pictures of some frames only; this is frame ${nearest}, the nearest.`;
    return [image, words];
  }

  showWall(i) {
    const wall = this.scene.walls[i];
    const key = document.createElement("p");
    key.innerHTML =
      `<span class="view-ramp view-ramp-wall"></span><small>Points within ${inUnits(0.5, 1)}: blue ` +
      `${inUnits(0.2, 1)} behind the drawn wall, grey on it, red as far before it.</small>`;
    this.open(wall.title, [this.list(wall.rows), key, this.row(this.showButton())]);
  }
}
