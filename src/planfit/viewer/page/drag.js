// The scan from above, dragged over the plan: by a mouse or a finger, turned at its handle or by a second finger;
// by arrow keys, and turned by [ and ], with shift in large steps. Let go, its pairs are handed on.
const STEP = { move: 0.1, turn: 1, large: 10 };
const TURN_KEYS = { "[": -1, "{": -STEP.large, "]": 1, "}": STEP.large };
const MOVE_KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

function dragged(svg, { up, unitsOfPixel }, shape, onLetGo) {
  // In the units of the picture, y down; degrees to the right.
  const anchors = shape.anchors.map(({ rim: [x, y] }) => [x, up * y]);
  const centre = [0, 1].map((k) => anchors.reduce((sum, at) => sum + at[k], 0) / anchors.length);
  const metre = Math.hypot(anchors[0][0] - centre[0], anchors[0][1] - centre[1]) / shape.anchor_m;
  const group = svg.appendChild(svgMade("g", { class: "hand-scan" }));
  group.appendChild(svgMade("path", { d: shape.points.map(([x, y]) => `M${x} ${up * y}h0`).join("") }));
  const handle = group.appendChild(svgMade("circle", { class: "hand-handle" }));
  const at = { x: 0, y: 0, turn: 0, isOn: false };
  const pointers = new Map();
  const now = () => [centre[0] + at.x, centre[1] + at.y];

  const placed = ([x, y]) => {
    const [c, s] = [Math.cos, Math.sin].map((f) => f((at.turn * Math.PI) / 180));
    const [dx, dy] = [x - centre[0], y - centre[1]];
    return [now()[0] + c * dx - s * dy, now()[1] + s * dx + c * dy];
  };
  const draw = () => {
    const px = unitsOfPixel();
    group.setAttribute("transform", `translate(${at.x} ${at.y}) rotate(${at.turn} ${centre[0]} ${centre[1]})`);
    for (const [name, value] of Object.entries({ cx: centre[0], cy: centre[1] - 36 * px, r: 11 * px }))
      handle.setAttribute(name, value);
    group.style.display = at.isOn ? "" : "none";
  };
  const letGo = () => onLetGo(shape.anchors.map(({ scan }, k) => {
    const [x, y] = placed(anchors[k]);
    return { scan, plan: [x, up * y].map((v) => Math.round(v * 1000) / 1000) };
  }));
  const turn = (degrees) => {
    at.turn = ((at.turn + degrees + 540) % 360) - 180;
    draw();
  };

  const inPicture = (event) => {
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [x, y];
  };
  const direction = (a, b) => (Math.atan2(b[1] - a[1], b[0] - a[0]) * 180) / Math.PI;
  const onDown = (event) => {
    event.stopImmediatePropagation();
    svg.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { from: inPicture(event), isHandle: event.target === handle });
  };
  const onMove = (event) => {
    event.stopImmediatePropagation();
    const own = pointers.get(event.pointerId);
    if (!own) return;
    const to = inPicture(event);
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (own.isHandle) turn(direction(now(), to) - direction(now(), own.from));
    else {
      const share = other ? 0.5 : 1; // two fingers move it by the mean of both
      at.x += share * (to[0] - own.from[0]);
      at.y += share * (to[1] - own.from[1]);
      if (other) turn(direction(other.from, to) - direction(other.from, own.from));
    }
    own.from = to;
    draw();
  };
  const onUp = (event) => {
    event.stopImmediatePropagation();
    if (pointers.delete(event.pointerId) && pointers.size === 0) letGo();
  };
  const onKey = (event) => {
    const by = MOVE_KEYS[event.key];
    if (by) {
      const step = STEP.move * (event.shiftKey ? STEP.large : 1) * metre;
      at.x += step * by[0];
      at.y += step * by[1];
    } else if (event.key in TURN_KEYS) turn(TURN_KEYS[event.key] * STEP.turn);
    else return;
    event.preventDefault();
    draw();
  };
  const onKeyUp = (event) => {
    if (event.key in MOVE_KEYS || event.key in TURN_KEYS) letGo();
  };
  // Before the map itself hears of them: it would move under the scan.
  const heard = { pointerdown: onDown, pointermove: onMove, pointerup: onUp, pointercancel: onUp };
  const others = { keydown: onKey, keyup: onKeyUp, click: (event) => event.stopImmediatePropagation() };
  return {
    draw,
    turn(degrees) {
      turn(degrees);
      letGo();
    },
    switchOn(isOn) {
      at.isOn = isOn;
      for (const [name, hear] of Object.entries({ ...heard, ...others }))
        svg[isOn ? "addEventListener" : "removeEventListener"](name, hear, { capture: true });
      draw();
      if (isOn) svg.focus();
    },
  };
}
