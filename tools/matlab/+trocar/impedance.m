classdef impedance < handle
    % For servo_ci: forces about a place, in axes of their own, and torques about an orientation; in the reference
    % frame.
    %
    % Errors that are positive go by one set of gains, those that are negative by another. Gains have their sign: a
    % negative p pulls back, a negative d brakes.

    properties
        force_position = [0 0 0]     % m
        force_orientation = eye(3)   % axes of the errors and gains of the place
        torque_orientation = eye(3)  % the orientation, and axes of its errors and gains
        position_positive
        position_negative
        orientation_positive
        orientation_negative
    end

    methods

        function self = impedance()
            % All gains 0.
            self.position_positive = trocar.gains();
            self.position_negative = trocar.gains();
            self.orientation_positive = trocar.gains();
            self.orientation_negative = trocar.gains();
        end

        function values = numbers(self)
            % The numbers of the command (1x59).
            positive = [self.position_positive.rows(), self.orientation_positive.rows()].';
            negative = [self.position_negative.rows(), self.orientation_negative.rows()].';
            values = [trocar.internal.sized(self.force_position, 3, 'force_position'), ...
                      trocar.internal.quaternion_of(self.force_orientation), ...
                      trocar.internal.quaternion_of(self.torque_orientation), positive(:).', negative(:).'];
        end

    end

end
