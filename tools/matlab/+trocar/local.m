classdef local < handle
    % The tip of an arm in that arm's base.

    properties (Access = private)
        bridge
        name
    end

    methods

        function self = local(bridge, name)
            % Made by trocar.arm.
            self.bridge = bridge;
            self.name = name;
        end

        function [pose, timestamp] = measured_cp(self)
            % Measured pose (4x4) of the tip.
            [pose, timestamp] = self.bridge.pose([self.name '/local/measured_cp']);
        end

        function [pose, timestamp] = setpoint_cp(self)
            % Setpoint of the tip.
            [pose, timestamp] = self.bridge.pose([self.name '/local/setpoint_cp']);
        end

        function [twist, timestamp] = measured_cv(self)
            % Twist (1x6) of the tip in its own axes.
            [twist, timestamp] = self.bridge.six([self.name '/local/measured_cv'], 'linear', 'angular');
        end

        function pose = forward_kinematics(self, jp)
            % Pose of the tip at these joints.
            pose = trocar.internal.matrix_of( ...
                trocar.internal.asked(self.bridge, self.name, 'local/forward_kinematics', jp));
        end

    end

end
