// Points of the cloud, pressed in the 3D view of the report, and the places of the scan drawn over it: each
// numbered, with a line to where it is on the plan.
function cloudPicks(section) {
  const { view } = section ?? {};
  if (!view?.renderer) return null; // no 3D view, or a browser that cannot show it
  const stage = section.querySelector(".view-stage");
  const svg = stage.appendChild(svgMade("svg", { class: "hand-over", "aria-hidden": "true" }));
  const picks = { pending: null, marks: [] };
  const dot = (at, words) => {
    if (!at) return;
    svg.appendChild(svgMade("circle", { cx: at[0], cy: at[1], r: words ? 9 : 6, class: words ? "" : "pending" }));
    svg.appendChild(svgMade("text", { x: at[0], y: at[1] + 4 })).textContent = words;
  };
  picks.draw = () => {
    svg.replaceChildren();
    picks.marks.forEach(({ frame, point, plan }, k) => {
      const [, , height] = view.inPlan(point, frame);
      const [at, to] = [view.drawnAt(point, frame), view.drawnAt([...plan, height])];
      if (at && to) {
        svg.appendChild(svgMade("line", { x1: at[0], y1: at[1], x2: to[0], y2: to[1] }));
        svg.appendChild(svgMade("circle", { cx: to[0], cy: to[1], r: 4, class: "target" }));
      }
      dot(at, String(k + 1));
    });
    if (picks.pending) dot(view.drawnAt(picks.pending.point, picks.pending.frame), "");
  };
  picks.take = (onPoint) => {
    view.onPoint = onPoint;
    stage.classList.toggle("is-picking", Boolean(onPoint));
    if (!onPoint) picks.pending = null;
    picks.draw();
  };
  view.onPaint = picks.draw;
  return picks;
}
