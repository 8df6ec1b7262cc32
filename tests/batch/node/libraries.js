// What the page of a batch uses of Observable Plot.
export { axisX, barX, dot, dotX, frame, lineY, plot, rect, rectY, ruleX, ruleY, text, tip, pointer } from "@observablehq/plot";
export { binX, stackX } from "@observablehq/plot";
