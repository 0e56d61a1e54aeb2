// Drawing of lines over time on a canvas, as sharp as the screen is.

const LEFT = 58;
const RIGHT = 10;
const never = () => false;

/** Steps of 1, 2 or 5 times a power of ten, about `count` of them. */
export function niceStep(span, count) {
  const raw = span / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const share = raw / power;
  return power * (share > 5 ? 10 : share > 2 ? 5 : share > 1 ? 2 : 1);
}

/** A range that holds [low, high] and is at least `least` wide, its ends on steps. */
export function niceRange(low, high, least) {
  if (!(low <= high)) return [0, least];
  const missing = Math.max(0, least - (high - low)) / 2;
  const step = niceStep(Math.max(high - low, least), 5);
  return [Math.floor((low - missing) / step) * step, Math.ceil((high + missing) / step) * step];
}

/** Colours as the style sheet has them at the moment. */
export function palette() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    grid: colour("line"), text: colour("muted"), ink: colour("ink"), limit: colour("bad"),
    measured: colour("measured"), second: colour("second"), reference: colour("reference"), band: colour("band"),
    shade: colour("shade"), zone: colour("zone"), good: colour("good"), font: `12px ${getComputedStyle(document.body).fontFamily}`,
  };
}

/** A canvas with axes: time along, one quantity up. */
export class Axes {
  constructor(canvas, { top = 8, bottom = 8 } = {}) {
    this.canvas = canvas;
    this.top = top;
    this.bottom = bottom;
    this.context = canvas.getContext("2d");
  }

  /** Make ready for a drawing; false where the canvas is not seen. */
  begin([from, to], [low, high], colours) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width < 80 || height < 30) return false;
    const scale = devicePixelRatio || 1;
    const [pixelsX, pixelsY] = [Math.round(width * scale), Math.round(height * scale)];
    if (this.canvas.width !== pixelsX) this.canvas.width = pixelsX;
    if (this.canvas.height !== pixelsY) this.canvas.height = pixelsY;
    this.context.setTransform(scale, 0, 0, scale, 0, 0);
    this.context.clearRect(0, 0, width, height);
    this.context.font = colours.font;
    this.box = { left: LEFT, right: width - RIGHT, top: this.top, bottom: height - this.bottom };
    Object.assign(this, { from, to, low, high, colours });
    return true;
  }

  x(time) {
    const { left, right } = this.box;
    return left + ((time - this.from) / (this.to - this.from)) * (right - left);
  }

  y(value) {
    const { top, bottom } = this.box;
    return bottom - ((value - this.low) / (this.high - this.low)) * (bottom - top);
  }

  /** Return the time at a position on the canvas. */
  timeAt(x) {
    const { left, right } = this.box;
    return this.from + (Math.min(Math.max(x, left), right) - left) / (right - left)
      * (this.to - this.from);
  }

  /** Lines at round values with their numbers; times too where `timeLabel` names them. */
  grid(timeStep, timeLabel = null) {
    const { context: pen, colours } = this;
    const { left, right, top, bottom } = this.box;
    const step = niceStep(this.high - this.low, Math.max(2, (bottom - top) / 29));
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    pen.lineWidth = 1;
    pen.strokeStyle = colours.grid;
    pen.fillStyle = colours.text;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.beginPath();
    for (let n = Math.ceil(this.low / step - 1e-6); n * step <= this.high + step * 1e-6; n += 1) {
      const y = Math.round(this.y(n * step)) + 0.5;
      pen.moveTo(left, y);
      pen.lineTo(right, y);
      pen.fillText((n * step).toFixed(decimals).replace("-", "\u2212"), left - 8,
        Math.min(Math.max(y, top + 5), bottom - 4));
    }
    pen.textAlign = "center";
    pen.textBaseline = "top";
    for (let n = Math.ceil(this.from / timeStep - 1e-9); n * timeStep <= this.to + 1e-9; n += 1) {
      const x = Math.round(this.x(n * timeStep)) + 0.5;
      pen.moveTo(x, top);
      pen.lineTo(x, bottom);
      if (timeLabel) {
        const label = timeLabel(n * timeStep);
        pen.fillText(label, Math.min(x, right + RIGHT - 1 - pen.measureText(label).width / 2), bottom + 6);
      }
    }
    pen.stroke();
  }

  /** A line through points given by functions of their index. It breaks where points without a value,
   * or a place that `torn` tells of, are longer than `gap`. */
  line(first, end, time, value, colour, { width = 1.6, dash = [], gap = Infinity, torn = never } = {}) {
    const pen = this.context;
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.lineJoin = "round";
    pen.setLineDash(dash);
    pen.beginPath();
    let before = null;
    let broken = false;
    for (let i = first; i < end; i += 1) {
      const [t, v] = [time(i), value(i)];
      broken ||= torn(i) || !Number.isFinite(v);
      if (!Number.isFinite(v)) continue;
      if (before !== null && !(broken && t - before > gap)) pen.lineTo(this.x(t), this.y(v));
      else pen.moveTo(this.x(t), this.y(v));
      before = t;
      broken = false;
    }
    pen.stroke();
    pen.setLineDash([]);
  }

  /** A band between two lines; it breaks where a line does. */
  band(first, end, time, low, high, colour, { gap = Infinity, torn = never } = {}) {
    let run = [];
    let broken = false;
    for (let i = first; i < end; i += 1) {
      const there = Number.isFinite(low(i)) && Number.isFinite(high(i));
      broken ||= torn(i) || !there;
      if (!there) continue;
      if (run.length && broken && time(i) - time(run.at(-1)) > gap) {
        this.fill(run, time, low, high, colour);
        run = [];
      }
      run.push(i);
      broken = false;
    }
    this.fill(run, time, low, high, colour);
  }

  fill(run, time, low, high, colour) {
    if (!run.length) return;
    const pen = this.context;
    pen.fillStyle = colour;
    pen.beginPath();
    // A single point is as wide as a line.
    const wide = run.length > 1 ? 0 : 1;
    for (const i of run) pen.lineTo(this.x(time(i)) - wide, this.y(high(i)));
    for (const i of run.toReversed()) pen.lineTo(this.x(time(i)) + wide, this.y(low(i)));
    if (wide) {
      const [x, top] = [this.x(time(run[0])), this.y(high(run[0]))];
      pen.rect(x - 1, top, 2, Math.max(1, this.y(low(run[0])) - top));
    }
    pen.fill();
  }

  /** A stretch of values over the whole time. */
  zone(low, high, colour) {
    const { left, right } = this.box;
    this.context.fillStyle = colour;
    this.context.fillRect(left, this.y(high), right - left, this.y(low) - this.y(high));
  }

  /** A stretch of time over all values, in a pale colour. */
  stretch(from, to, hue) {
    this.shade(from, to, `hsl(${hue} 60% 50% / 12%)`);
  }

  /** A stretch of time over all values. */
  shade(from, to, colour) {
    const { left, right, top, bottom } = this.box;
    const begin = Math.max(left, this.x(from));
    this.context.fillStyle = colour;
    this.context.fillRect(begin, top, Math.max(1, Math.min(right, this.x(to)) - begin), bottom - top);
  }

  /** Keep what follows within the axes. */
  clip() {
    const { left, right, top, bottom } = this.box;
    this.context.save();
    this.context.beginPath();
    this.context.rect(left, top - 2, right - left, bottom - top + 4);
    this.context.clip();
  }

  unclip() {
    this.context.restore();
  }

  upright(time, colour, dash = []) {
    const x = Math.round(this.x(time)) + 0.5;
    this.straight([x, this.box.top], [x, this.box.bottom], colour, dash);
  }

  level(value, colour, dash = []) {
    const y = Math.round(this.y(value)) + 0.5;
    this.straight([this.box.left, y], [this.box.right, y], colour, dash);
  }

  straight(from, to, colour, dash) {
    const pen = this.context;
    pen.strokeStyle = colour;
    pen.lineWidth = 1;
    pen.setLineDash(dash);
    pen.beginPath();
    pen.moveTo(...from);
    pen.lineTo(...to);
    pen.stroke();
    pen.setLineDash([]);
  }

  /** Names of phases above the axes, each [begin, name], where there is room for them. */
  names(starts, end) {
    const pen = this.context;
    pen.textAlign = "center";
    pen.textBaseline = "bottom";
    pen.fillStyle = this.colours.text;
    for (const [place, [begin, name]] of starts.entries()) {
      const from = Math.max(this.box.left, this.x(begin));
      const to = this.x(starts[place + 1]?.[0] ?? end);
      if (name && pen.measureText(name).width + 6 <= to - from) {
        pen.fillText(name, (from + to) / 2, this.box.top - 4);
      }
    }
  }
}
