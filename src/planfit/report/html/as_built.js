// Verdicts of walls follow the tolerance: only of walls that stand, which agree or were moved.
for (const section of document.querySelectorAll("section.as-built")) {
  const input = section.querySelector(".as-built-tolerance");
  const words = ["agrees", "moved", "missing", "not seen", "new"];
  const judge = () => {
    const tolerance = Number(input.value) * Number(input.dataset.metres);
    if (input.value === "" || !(tolerance >= 0)) return;
    const verdicts = new Map();
    for (const one of section.querySelectorAll("[data-offset]")) {
      const { face, offset, sigma } = one.dataset;
      const off = Math.abs(Number(offset));
      const verdict = off > tolerance ? "moved" : "agrees";
      const unsure = Math.abs(off - tolerance) <= Number(input.dataset.sure) * Number(sigma);
      const signed = `${Number(offset) < 0 ? "-" : "+"}${inUnits(off, 3)}`;
      verdicts.set(face, { verdict, words: `${verdict}: off by ${signed} (± ${inUnits(Number(sigma), 3)})` });
      one.classList.toggle("as-built-moved", verdict === "moved");
      one.classList.toggle("as-built-agrees", verdict === "agrees");
      if (one.tagName !== "TR") continue;
      one.classList.toggle("unsure", unsure);
      one.cells[1].textContent = one.cells[1].dataset.key = verdict;
    }
    const count = (word) => section.querySelectorAll(`g.as-built-${word.replace(" ", "-")}`).length;
    section.querySelector(".as-built-counts").textContent = words.map((w) => `${count(w)} ${w}`).join(", ");
    document.dispatchEvent(new CustomEvent("as-built", { detail: verdicts })); // the 3D view has them too
  };
  input.addEventListener("input", judge);
}
