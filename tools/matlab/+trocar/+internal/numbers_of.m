function numbers = numbers_of(pose)
    % x y z, quaternion x y z w (1x7) of a 4x4 matrix; trocar:argument when it is no rigid transform.
    if ~isnumeric(pose) || ~isreal(pose) || ~isequal(size(pose), [4, 4])
        error('trocar:argument', 'a pose is a 4x4 matrix of real numbers');
    end
    if ~all(isfinite(pose(:))) || max(abs(pose(4, :) - [0, 0, 0, 1])) > 1e-9
        error('trocar:argument', 'this 4x4 matrix is no pose: its last row has to be 0 0 0 1');
    end
    numbers = [double(pose(1:3, 4)).', trocar.internal.quaternion_of(pose(1:3, 1:3))];
end
