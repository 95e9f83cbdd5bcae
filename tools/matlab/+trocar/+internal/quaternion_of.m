function q = quaternion_of(rotation)
    % The quaternion x y z w (1x4) of a 3x3 matrix; trocar:argument when it is no rotation.
    if ~isnumeric(rotation) || ~isreal(rotation) || ~isequal(size(rotation), [3, 3])
        error('trocar:argument', 'a rotation is a 3x3 matrix of real numbers');
    end
    r = double(rotation);
    if ~all(isfinite(r(:))) || max(max(abs(r * r.' - eye(3)))) > 1e-6 || det(r) < 0
        error('trocar:argument', 'this matrix is no rotation');
    end
    squares = [1 + r(1, 1) - r(2, 2) - r(3, 3), 1 - r(1, 1) + r(2, 2) - r(3, 3), ...
               1 - r(1, 1) - r(2, 2) + r(3, 3), 1 + trace(r)];  % four times those of x, y, z and w
    [largest, which] = max(squares);
    switch which  % divide by the largest, which is never near 0
        case 1
            q = [largest, r(1, 2) + r(2, 1), r(1, 3) + r(3, 1), r(3, 2) - r(2, 3)];
        case 2
            q = [r(1, 2) + r(2, 1), largest, r(2, 3) + r(3, 2), r(1, 3) - r(3, 1)];
        case 3
            q = [r(1, 3) + r(3, 1), r(2, 3) + r(3, 2), largest, r(2, 1) - r(1, 2)];
        otherwise
            q = [r(3, 2) - r(2, 3), r(1, 3) - r(3, 1), r(2, 1) - r(1, 2), largest];
    end
    q = q / norm(q);
end
