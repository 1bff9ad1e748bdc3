"""glTF 2.0 reader: container -> schema -> accessors -> meshes, materials, nodes, animations -> Scene."""
