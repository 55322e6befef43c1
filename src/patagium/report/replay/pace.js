"use strict";
// How many pixels the robot is drawn with: while time passes as many as leave 30 frames a
// second, at rest all of them. Thirty frames are one in 33 ms; some room is left, since a
// screen may show no more than that.

const SLOW = 36, QUICK = 24; // ms between frames
const COARSEST = 0.4; // of the finest

class Pace {
  constructor() {
    this.share = 1; // pixels along an edge, of the finest
    this.gap = 0; // between frames, smoothed [ms]
    this.frames = 0; // since the share changed
    this.patience = 90; // frames before finer ones are tried
  }

  // One more frame while time passes, so long after the one before.
  heed(gap) {
    if (gap > 1000) return; // the page was not looked at
    this.gap = this.frames ? this.gap + 0.25 * (Math.min(gap, 400) - this.gap) : gap;
    this.frames += 1;
    if (this.frames >= 4 && this.gap > SLOW && this.share > COARSEST) {
      if (this.tried) this.patience = Math.min(4 * this.patience, 6000);
      this.change(Math.max(COARSEST, this.share * Math.min(0.85, Math.max(0.5, Math.sqrt(30 / this.gap)))));
    } else if (this.frames >= this.patience && this.gap < QUICK && this.share < 1) {
      this.tried = true; // too fine at once after this: wait longer next time
      this.change(Math.min(1, 1.25 * this.share));
    }
  }

  change(share) {
    this.share = share;
    this.frames = 0;
  }
}

// Whether the graphics card is the processor: smoothed edges cost it four times the pixels.
function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return false;
  const told = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}
