// A frame's image, in which a point is picked: pixels of the image as planfit reads it, centres at integers.
function imagePicker(figure) {
  const [input, box] = [figure.querySelector("input"), figure.querySelector(".hand-picture")];
  const [image, mark] = [box.querySelector("img"), box.querySelector("i")];
  const picker = { frame: 0, pixel: null };
  const draw = () => {
    mark.hidden = !picker.pixel || !image.naturalWidth;
    if (mark.hidden) return;
    const [x, y] = [(picker.pixel[0] + 0.5) / image.naturalWidth, (picker.pixel[1] + 0.5) / image.naturalHeight];
    Object.assign(mark.style, { left: `${100 * x}%`, top: `${100 * y}%` });
  };
  picker.show = (frame, pixel = null) => {
    picker.frame = frame;
    picker.pixel = pixel;
    input.value = String(frame);
    image.src = `frame/${frame}`;
    draw();
  };
  image.addEventListener("load", draw);
  input.addEventListener("change", () => {
    const last = Number(input.max);
    picker.show(Math.max(0, Math.min(last, Math.round(Number(input.value)) || 0)));
  });
  box.addEventListener("click", (event) => {
    const rim = image.getBoundingClientRect();
    if (!image.naturalWidth || !rim.width) return;
    const [x, y] = [(event.clientX - rim.left) / rim.width, (event.clientY - rim.top) / rim.height];
    picker.pixel = [x * image.naturalWidth - 0.5, y * image.naturalHeight - 0.5].map((v) => Math.round(v * 10) / 10);
    draw();
  });
  return picker;
}
