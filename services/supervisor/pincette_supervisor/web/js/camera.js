// The picture of the rig's camera: MJPEG, which the browser requests from the camera itself.

import { RIG } from "./api.js";
import { byId, h } from "./dom.js";

const AGAIN_MS = 5000;

/** Show the camera that the rig file names, while the page is seen. */
export function watchCamera() {
  const address = document.documentElement.dataset.camera;
  if (!address) return;
  const picture = h("img", { alt: `The camera of ${RIG}`, id: "camera-picture" });
  const said = h("p", { class: "muted small", id: "camera-said", role: "status" });
  byId("camera").append(h("figcaption", {}, h("b", {}, "Camera")), picture, said);
  byId("camera").hidden = false;
  let timer = 0;
  const settle = () => {
    clearTimeout(timer);
    if (document.hidden) picture.removeAttribute("src");
    else picture.src = address;
  };
  picture.addEventListener("load", () => {
    picture.hidden = false;
    said.textContent = "";
  });
  picture.addEventListener("error", () => {
    if (document.hidden) return;
    picture.hidden = true;
    said.textContent = `No picture from ${address}; trying again.`;
    timer = setTimeout(settle, AGAIN_MS);
  });
  document.addEventListener("visibilitychange", settle);
  settle();
}
