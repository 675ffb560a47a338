// Corrections by hand: each goes to the file at once; the page keeps nothing of its own.
const hand = document.getElementById("hand");
// Parts of the panel move beside the 3D view while a scan is placed by pairs.
const of = (name) => document.querySelector(`.hand-${name}`);
const say = (words, isBad = false) => {
  of("status").textContent = words;
  of("status").classList.toggle("hand-bad", isBad);
};

async function ask(name, body) {
  const request = body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  let answer;
  try {
    answer = await fetch(name, request);
  } catch {
    throw new Error("planfit view has ended; what was corrected is in corrections.toml: start it again");
  }
  const isJson = (answer.headers.get("Content-Type") || "").startsWith("application/json");
  const found = isJson ? await answer.json() : { error: await answer.text() };
  if (!answer.ok) throw new Error(found.error);
  return found;
}

const button = (words, action) => {
  const made = document.createElement("button");
  Object.assign(made, { type: "button", textContent: words });
  made.addEventListener("click", action);
  return made;
};

const item = (list, words, ...children) => {
  const made = document.createElement("li");
  made.append(`${words} `, ...children);
  list.append(made);
  return made;
};

// One after the other: a solve that is asked for just after a correction has it.
let lastChange = Promise.resolve();
async function change(name, body, words) {
  const answer = lastChange.then(() => ask(name, body));
  lastChange = answer.catch(() => {});
  try {
    draw(await answer);
    say(words);
  } catch (error) {
    say(error.message, true);
  }
}

function draw(state) {
  for (const name of ["a", "b"]) of(name).max = String(state.frames - 1);
  of("list").replaceChildren();
  for (const each of state.corrections) {
    const came = !each.is_solved ? "not solved with yet"
      : each.contradicted ? `contradicted: ${each.contradicted}`
        : each.residual_m === null ? "used" : `used, ${inUnits(each.residual_m, 2)} apart in the result`;
    const note = each.note ? ` (${each.note})` : "";
    const row = item(of("list"), `${each.words}${note}; ${came}`,
      button("take out", () => change("remove", each, "taken out")));
    row.classList.toggle("hand-bad", Boolean(each.contradicted));
  }
  of("visits").replaceChildren();
  for (const visit of state.visits) {
    const [first, last] = [visit.first_frames, visit.last_frames];
    const words = `frames ${first.join("-")} and ${last.join("-")}: ${inUnits(visit.after_m, 3)} apart, `
      + `${inUnits(visit.kept_out_m, 3)} without this loop`;
    item(of("visits"), words,
      button("show", () => { a.show(first[0]); b.show(last[0]); }),
      button("delete", () => change("add", { kind: "delete_loop", entry: { frames: [first, last] } }, "loop deleted")));
  }
  of("against").hidden = state.disagreements.length === 0;
  of("disagreements").replaceChildren();
  for (const { words, frames, correction } of state.disagreements) {
    const buttons = [];
    if (frames.length === 2) buttons.push(button("show", () => { a.show(frames[0]); b.show(frames[1]); }));
    const does = { delete_loop: ["delete", "loop deleted"], exclude_wall: ["do not use", "wall left out"] }[correction?.kind];
    if (does) buttons.push(button(does[0], () => change("add", correction, does[1])));
    item(of("disagreements"), words, ...buttons);
  }
  const rows = state.changed.map((cells) => {
    const row = document.createElement("tr");
    row.append(...cells.map((cell) => Object.assign(document.createElement("td"), { textContent: cell })));
    return row;
  });
  of("changed").hidden = rows.length === 0;
  of("changed").querySelector("tbody").replaceChildren(...rows);
  of("solve").disabled = state.solving;
  showMarks(state.corrections.map((each) => each.mark).filter(Boolean));
  if (state.failed) say(state.failed, true);
}

const [a, b] = [...hand.querySelectorAll("figure")].map(imagePicker);
let map = { point: null, before: null, wall: null, marks: [], draw() {}, clear() {} };
let picks = null;
let marks = [];
function showMarks(found) {
  [marks, map.marks] = [found, found];
  map.draw();
  if (!picks) return;
  picks.marks = found;
  picks.draw();
}
const add = (kind, entry, words) => change("add", { kind, entry }, words);
of("add").addEventListener("click", () => {
  const pixels = a.pixel && b.pixel ? { pixels: [a.pixel, b.pixel] } : {};
  add("add_loop", { frames: [a.frame, b.frame], ...pixels }, "loop added");
});
of("delete").addEventListener("click", () => add("delete_loop", { frames: [a.frame, b.frame] }, "loop deleted"));
of("exclude").addEventListener("click", () => {
  const [first, last] = [a.frame, b.frame].sort((x, y) => x - y);
  add("exclude_frames", { frames: [[first, last]] }, "frames left out");
});
of("place").addEventListener("click", () => {
  if (!a.pixel || !map.point) return say("press a point in A, and on the plan", true);
  add("place", { frame: a.frame, pixel: a.pixel, plan: map.point }, "placed; three points are safest");
});

// Pairs: a point of the cloud, then the same one on the plan, which beside it is drawn meanwhile.
const PAIRS = 3;
async function takePoint(found) {
  if (!found) return say("there is no point of the cloud; press one", true);
  try {
    const { pixel } = await ask("pixel", found);
    picks.pending = found;
    picks.draw();
    a.show(found.frame, pixel);
    say("now the same point on the plan");
  } catch (error) {
    say(error.message, true);
  }
}
async function takePlan(point) {
  if (!picks?.pending || !a.pixel) return;
  picks.pending = null;
  map.clear();
  const missing = PAIRS - 1 - marks.length;
  const words = missing > 0 ? `${missing} more ${missing > 1 ? "pairs" : "pair"}, far apart: the next point of the cloud`
    : "placed: solve again, or give more pairs";
  await add("place", { frame: a.frame, pixel: a.pixel, plan: point }, words);
}
of("pairs").addEventListener("change", ({ target }) => {
  const stage = document.querySelector(".hand-beside");
  stage.classList.toggle("is-pairing", target.checked);
  map.clear();
  if (target.checked) stage.append(of("status"), of("plan"), of("solving"));
  else {
    of("buttons").after(of("plan"));
    of("list").after(of("solving"));
    of("details").querySelector("summary").after(of("status"));
  }
  picks.take(target.checked ? takePoint : null);
  if (!target.checked) return say("");
  document.getElementById("view").view.orbit.reset(); // the picture has another shape now
  stage.scrollIntoView({ block: "nearest" });
  say("press a point of the cloud that the plan shows too, as a corner at the floor or a door");
});
// The scan dragged over the plan: what it is let go at is saved at once.
let drag = null;
of("drag").addEventListener("change", async ({ target }) => {
  try {
    if (!drag) {
      const shape = await ask("shape");
      drag = dragged(of("plan").querySelector("svg"), map, shape,
        (pairs) => change("drag", { pairs }, "placed where it was let go: solve again, or drag it on"));
      map.onDraw = drag.draw;
    }
    map.clear();
    drag.switchOn(target.checked);
    for (const name of ["turn-left", "turn-right"]) of(name).hidden = !target.checked;
    of("plan").querySelector("svg").classList.toggle("is-dragging", target.checked);
    if (target.checked) say("drag the scan to its place, turn it at its handle; arrow keys, [ and ] do the same");
  } catch (error) {
    target.checked = false;
    say(error.message, true);
  }
});
of("turn-left").addEventListener("click", () => drag.turn(-15));
of("turn-right").addEventListener("click", () => drag.turn(15));
for (const [name, kind] of [["unuse", "exclude_wall"], ["erase", "erase_wall"]])
  of(name).addEventListener("click", () => {
    if (!map.wall) return say("press a wall of the plan", true);
    add(kind, { ends: map.wall }, "wall corrected");
  });
of("draw").addEventListener("click", () => {
  if (!map.before || !map.point) return say("press the two ends on the plan", true);
  add("draw_wall", { ends: [map.before, map.point] }, "wall drawn");
});
of("solve").addEventListener("click", async () => {
  await change("solve", {}, "solving …");
  watch();
});

// The report is another one after a solve; what changed is told on the new page.
async function watch() {
  for (;;) {
    await new Promise((wake) => setTimeout(wake, 700));
    try {
      const state = await ask("state");
      if (state.solving) continue;
      if (!state.failed) return location.reload();
      return draw(state);
    } catch (error) {
      return say(error.message, true);
    }
  }
}

// Beside the 3D view; the frame that is chosen there, in plots or in tables is frame A.
document.getElementById("view")?.after(hand);
const [slider, shown] = [".view-frame", ".view-frame-words"].map((name) => document.querySelector(name));
if (slider && shown)
  new MutationObserver(() => a.show(Number(slider.value)))
    .observe(shown, { childList: true, characterData: true, subtree: true });

const viewReady = (section) => new Promise((done) => {
  const isDone = () => ["ready", "failed"].includes(section.dataset.state);
  if (isDone()) return done();
  const watching = new MutationObserver(() => isDone() && (watching.disconnect(), done()));
  return watching.observe(section, { attributes: true, attributeFilter: ["data-state"] });
});

// A frame for cloud and plan side by side.
function beside(stage) {
  const frame = document.createElement("div");
  frame.className = "hand-beside";
  stage.replaceWith(frame);
  frame.append(stage);
}

(async () => {
  try {
    const state = await ask("state");
    draw(state);
    a.show(0);
    b.show(state.frames - 1);
    const plan = await ask("plan");
    of("plan").hidden = plan.faces.length === 0;
    map = planMap(of("plan").querySelector("svg"), plan, takePlan);
    of("nearer").addEventListener("click", () => map.zoom(0.7));
    of("further").addEventListener("click", () => map.zoom(1 / 0.7));
    const section = document.getElementById("view");
    if (section) await viewReady(section);
    picks = plan.faces.length ? cloudPicks(section) : null;
    if (section) {
      section.after(hand); // what corrects is at hand where it is seen
      section.querySelector("h2").after(of("hint"));
      of("hint").hidden = false;
      if (!scrollY) section.scrollIntoView();
    }
    if (picks) {
      beside(section.querySelector(".view-stage"));
      section.querySelector(".view-tools").append(of("pairing"));
      of("pairing").hidden = false;
    }
    showMarks(marks);
    hand.dataset.ready = "1";
    if (state.solving) watch();
  } catch (error) {
    say(error.message, true);
  }
})();
