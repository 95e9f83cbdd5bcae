function matrix = matrix_of(pose)
    % The 4x4 matrix of x y z, quaternion x y z w.
    q = pose(4:7) / norm(pose(4:7));
    x = q(1);
    y = q(2);
    z = q(3);
    w = q(4);
    matrix = [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), pose(1);
              2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), pose(2);
              2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), pose(3);
              0, 0, 0, 1];
end
