// What the HTML picture uses of others: the layout of trees, and zooming by wheel, mouse and fingers.
export { flextree } from "d3-flextree";
export { select } from "d3-selection";
export { zoom, zoomIdentity } from "d3-zoom";
