// Choosing a stretch of time by dragging over a chart, with a mouse, a pen or a finger. `touch-action` of
// the canvases leaves vertical motions and two fingers to the browser, which then cancels the drag.

const LEAST_PX = 8;

/** Follow drags over the canvases in `place`; `axesOf` has the axes of a canvas. `picking` is called with
 * the two times that are dragged over, or null, and `chosen` with those at the end. */
export function onDrag(place, axesOf, { picking, chosen }) {
  let drag = null;
  const x = (event) => event.clientX - drag.canvas.getBoundingClientRect().left;
  const times = (event) => [drag.from, x(event)].sort((a, b) => a - b).map((each) => drag.axes.timeAt(each));
  const end = () => {
    drag = null;
    picking(null);
  };
  place.addEventListener("pointerdown", (event) => {
    const canvas = event.target.closest("canvas");
    const axes = canvas && axesOf(canvas);
    if (drag || event.button !== 0 || !axes?.box) return;
    drag = { canvas, axes, pointer: event.pointerId };
    drag.from = x(event);
    canvas.setPointerCapture(event.pointerId);
  });
  place.addEventListener("pointermove", (event) => {
    if (drag?.pointer === event.pointerId && Math.abs(x(event) - drag.from) >= LEAST_PX) picking(times(event));
  });
  place.addEventListener("pointerup", (event) => {
    if (drag?.pointer !== event.pointerId) return;
    const found = Math.abs(x(event) - drag.from) >= LEAST_PX ? times(event) : null;
    end();
    if (found && found[1] > found[0]) chosen(found);
  });
  place.addEventListener("pointercancel", (event) => drag?.pointer === event.pointerId && end());
}
