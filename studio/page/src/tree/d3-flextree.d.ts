declare module "d3-flextree" {
  interface FlexNode<T> {
    data: T;
    depth: number;
    x: number;
    y: number;
    descendants(): FlexNode<T>[];
  }
  interface Flextree<T> {
    (tree: FlexNode<T>): FlexNode<T>;
    hierarchy(data: T, children: (data: T) => T[]): FlexNode<T>;
  }
  export function flextree<T>(options: { nodeSize(node: FlexNode<T>): [number, number] }): Flextree<T>;
}
