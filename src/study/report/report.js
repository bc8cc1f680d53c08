"use strict";
(() => {
  const widget = document.querySelector("#compare");
  if (!widget) return;
  const part = (name) => widget.querySelector(name);
  const source = (id) => document.getElementById(id)?.src ?? "";
  const show = () => {
    const left = part("#left").value, right = part("#right").value;
    part(".stack .left").src = source("image-" + left);
    part(".stack .right").src = source("image-" + right);
    const flip = source("flip-" + right);
    part(".flip").hidden = !flip;
    if (flip) part(".flip img").src = flip;
  };
  const split = () => part(".stack").style.setProperty("--split", part("#split").value + "%");
  part("#left").addEventListener("change", show);
  part("#right").addEventListener("change", show);
  part("#split").addEventListener("input", split);
  const drag = (event) => {
    if (event.buttons === 0) return;
    const box = part(".stack").getBoundingClientRect();
    part("#split").value = Math.min(100, Math.max(0, 100 * (event.clientX - box.left) / box.width));
    split();
  };
  part(".stack").addEventListener("pointerdown", drag);
  part(".stack").addEventListener("pointermove", drag);
  show();
  split();
})();
